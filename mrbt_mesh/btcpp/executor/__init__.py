"""Ticks a tree on one robot.

`node`, `controls`, `decorators`, `timed`, `nav2`, `builtin_leaves`, `leaf_nodes`: the nodes.
`blackboard` and `leaves`: what nodes read, write and call. `builder` makes the nodes of a file,
`tree_executor` ticks them without waiting, `runner` runs them in an event loop, and `tree` is the
interface for programs.
"""
