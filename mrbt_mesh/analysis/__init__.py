"""What can be known of a mission before it runs, and team trees made of one robot's tree.

`tolerance`: the faults that a mission survives, and what to add (`mrbt analyze`). `lift`: actions
of one robot's tree become global tasks of a team (`mrbt tree lift`).

It may import formats and the core, never what runs robots. A figure is exact and proved, or given
as a range.
"""
