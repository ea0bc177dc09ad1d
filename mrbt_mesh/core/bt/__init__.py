"""Behavior trees: nodes as data, names of activations, and the definition of a tick.

`evaluator` has one place for the rule of each kind of node; `activation` says to what an outcome
belongs. Imports nothing of the project. A tree holds no run state; nothing here is written for
speed.
"""
