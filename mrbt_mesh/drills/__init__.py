"""Drills: missions on real processes, with faults at chosen moments, judged from what was done.

`model` and `drill_file` read a drill, `triggers` decides when a step is due, `inject` carries
it out, `network` and `namespaces` disturb links, `runner` follows the team, `judge` says what
held (from `physical` and `journals`), `report` tells it to programs.

It may import the runtime, which starts and stops the processes, and what is below; never `sim`. A
verdict rests on what robots did and wrote down.
"""
