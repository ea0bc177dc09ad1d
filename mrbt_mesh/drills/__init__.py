"""Drills: missions on real processes, with faults at chosen moments, judged from what was done.

`model` and `drill_file` read a drill, `triggers` decides when a step is due, `inject` carries
it out, `network` and `namespaces` disturb links, `runner` follows the team, `judge` says what
held (from `physical` and `journals`), `report` tells it to programs. `control` and `watched` carry
faults and steps out on a team that somebody watches, and nobody judges.

It may import the runtime, which starts and stops the processes, and what is below; never `sim`. A
verdict rests on what robots did and wrote down.
"""
