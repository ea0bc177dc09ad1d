"""One robot's process, and teams of them on one machine.

`driver` runs an agent: it hands it the clock and what arrives, and carries out its effects over
`zenoh_transport`, `actions` (the user's `program`) and the `journal`; `robot_process` puts it
together. `launcher`, `team`, `run_dir`, `known_runs`: processes, and where they are found.
`watcher` observes.

It may import formats and the core, and it alone imports Zenoh. It decides nothing.
"""
