"""What can be told of a mission beforehand: which faults it survives, and a team's tree made of one
robot's.

Faults: `service`, `readings` and `width` say what must be feasible at one time, `requirement` what
the tree cannot do without; `breaking`, `model` and `tolerance` count faults, `lemmas` compare with
the paper, `advice` says what to add, `cautions` what a mission hardly means; `analyse` is all of it
as data. Trees: `effects` says what
touches what, `arrange` makes Parallels of an order, `lift` and `lift_mission` use both.

It may import formats and the core, never what runs robots. A figure is exact and proved, or given
as a range.
"""
