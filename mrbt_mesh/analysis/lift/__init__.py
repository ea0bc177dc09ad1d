"""A team's mission made of a single robot's tree.

`effects` finds what each subtree reads and writes, `arrange` makes Parallels of a partial order,
`lifter` and `mission` use both; `units` splits a tree where one robot must do more than one action,
`in_units` makes the mission of it.
"""
