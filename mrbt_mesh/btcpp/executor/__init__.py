"""Ticks a tree on one robot.

`node`, `controls`, `decorators`, `timed`, `nav2`, `builtin_leaves` and `leaf_nodes` define the
nodes. `blackboard` holds the entries that nodes read and write, `leaves` the functions they call.
`builder` makes the nodes of a file, `tree_executor` ticks them without waiting, `runner` runs them
in an event loop, and `tree` is the interface for programs.
"""
