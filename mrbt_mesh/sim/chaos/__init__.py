"""Random faults and missions, many seeds, and failures cut down to what is needed for them.

`draw` makes a scenario of a seed, `generate` a mission (its robots: `random_robot`), `campaign`
runs many seeds, `minimise` cuts down.

A seed determines the whole run, so a failure can be replayed from it.
"""
