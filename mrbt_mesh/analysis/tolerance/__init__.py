"""Which faults a mission survives: `analyse` is the whole analysis as data.

`service`, `bound` and `readings` define what must be feasible at one time, `requirement` what the
tree cannot do without; `model` and `fault_counts` count faults, `advice` finds the cheapest
additions.
"""
