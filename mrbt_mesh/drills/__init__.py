"""Drills: missions on real processes, with faults at chosen moments, judged by what was done.

`model` and `drill_file` read a drill, `triggers` decides when a step is due, `inject` carries it
out, `network` and `namespaces` disturb links, `runner` follows the team, `judge` finds which
expectations held (from `physical` and `journals`), `report` writes that for programs. `control` and
`watched` carry faults and steps out on a team that is watched and not judged.

It may import the runtime, which starts and stops the processes, and what is below; never `sim`. A
result rests on what robots did and wrote down.
"""
