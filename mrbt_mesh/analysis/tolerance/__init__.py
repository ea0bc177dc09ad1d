"""Which faults a mission survives: `analyse` is the whole analysis as data.

`service`, `readings` and `width` define what must be feasible at one time, `requirement` what the
tree cannot do without; `breaking`, `model` and `fault_counts` count faults, `advice` finds the
cheapest additions, `cautions` finds what a mission can hardly mean.
"""
