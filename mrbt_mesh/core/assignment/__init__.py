"""The assignment problem, what solves it, and the one optimum that the order of names picks.

Imports nothing of the project but `errors`. Exact and in whole numbers: any solver, on any
machine, leads to the same answer.
"""
