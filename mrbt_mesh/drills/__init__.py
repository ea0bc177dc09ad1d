"""Drills: missions on real processes, with faults at chosen moments, judged from what was done.

`model` and `drill_file` read a drill, `triggers` decides when a step is due, `crew` and
`runner` carry it out, `judge` says what held, `report` tells it to programs.
"""
