"""One robot's process, and teams of processes on one machine.

`driver` runs an agent: it passes it the clock and what arrives, and carries out its effects over
`zenoh_transport`, `actions` (the user's `program`) and the `journal`; `robot_process` assembles it.
`launcher`, `team`, `run_dir` and `known_runs` start processes and find them. `watcher` observes.

It may import formats and the core, and only it imports Zenoh. It makes no decisions.
"""
