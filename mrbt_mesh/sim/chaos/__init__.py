"""Random faults and missions, many seeds, and failures cut down to what is needed for them.

`draw` makes a scenario of a seed, `generate` a mission (its robots: `random_robot`), `campaign`
runs many seeds, `minimise` cuts down.

Imports `run`, `checkers` and `engine`, never `statistics`. A seed says everything: a failure can
be replayed from it.
"""
