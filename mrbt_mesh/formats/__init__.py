"""Files: what users write becomes missions, and missions become files.

`mission_model` and `tree_model` say what may stand in a mission file, `yaml_source` keeps its
lines, `expand` and `build` make the mission, `mission_file` reads and compiles it, `problems` are
told with file and line. `facts_file`, `team_file` and `assignment_file` are read by `mrbt plan`,
`lift` and `assign`. `shipped` and `template` are what users start from. `mission_map`: the map in a
mission's parameters. `btcpp`: trees in XML, as BehaviorTree.CPP has them.

It may import the core alone. Whatever stands in a file, it is read, or refused with its place.
"""
