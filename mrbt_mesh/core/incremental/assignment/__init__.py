"""The canonical optimum brought up to date along shortest augmenting paths.

In place of `assignment.solve.optimum`: `reassign` keeps the last problem and its `optimum`, and
goes from one to the next along paths in the `residual` graph; `ties` picks the canonical one.

Imports `assignment` alone. Whatever takes too long this way is solved from scratch; the answer is
the same.
"""
