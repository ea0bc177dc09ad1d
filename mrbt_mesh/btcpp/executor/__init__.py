"""What ticks a tree on one robot.

`node`, `controls`, `decorators`, `timed`, `nav2`, `builtin_leaves`, `leaf_nodes`: what each node
does in a tick. `blackboard`, `leaves`: what nodes read, write and call. `builder` makes them from a
file, `engine` ticks them without waiting, `runner` runs them in an event loop, and `tree` is the
interface for programs.
"""
