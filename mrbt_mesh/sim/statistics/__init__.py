"""Many runs with faults by chance: how likely a mission succeeds, and how long it takes.

`estimate` makes the runs and counts, `sweeps` says what may vary, `team_sizes` forms other teams,
`plotting` draws (the only place that needs matplotlib).

Imports `run` and `engine`, never `chaos`. Nothing is checked in these runs.
"""
