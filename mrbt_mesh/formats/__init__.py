"""Files that users write: missions, teams, facts, costs, units; and the files they start from.

`mission_model` and `tree_model` describe the shape of a mission file; `expand` and `build` make the
mission; `compiled` is the form that robots load. `yaml_source` reads YAML with line numbers,
`problems` reports what is wrong with file and line. `mission_map` is the map in a mission's
parameters. Every file is read, or refused with the place of each problem.
"""
