"""Drills: missions on real processes with faults at chosen moments, judged by what was done.

`model` and `drill_file` read a drill, `triggers` decides when a step is due, `inject` carries it
out, `network` and `namespaces` disturb links, `runner` follows the team, `judge` decides which
expectations held (from `physical` and `journals`), and `report` writes the results for programs.
`control` and `watched` carry out faults and steps on a team that is watched but not judged.

It may import the runtime, which starts and stops the processes, and the layers below; never `sim`.
A result is based on what robots did and wrote.
"""
