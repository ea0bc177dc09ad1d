"""Evaluating a tree again: only what changed facts can influence.

In place of `bt.evaluator.Evaluator`: `evaluator` follows a team's facts (`fact_changes`) and brings
its last tick up to date (`update`); `compiled_evaluator` ticks from scratch over flat lists.

Imports `facts`, `mission` and `bt`, nothing else of `incremental`. The evaluations are equal.
"""
