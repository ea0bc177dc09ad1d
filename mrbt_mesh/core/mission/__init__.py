"""The mission, which is fixed before a run: robots, tasks, side constraints, the tree.

Imports `bt` only. Everything is immutable and has a digest.
"""
