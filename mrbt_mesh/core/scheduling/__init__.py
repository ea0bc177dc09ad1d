"""Schedules: which robots carry out which tasks in which order, where robots have to travel.

Imports nothing of the project. All in whole numbers (milliseconds), without a clock and without
randomness: the same problem, seed and number of evaluations lead to the same schedule anywhere.
"""
