"""BehaviorTree.CPP v4 XML: reading, checking, writing, and its scripting language.

`xml_reader`, `elements`, `document`: a file as data, without loss, and what its parts mean.
`upgrade` (version 3), `library` (includes), `check` (the rules), `script` (the language). `expand`
puts SubTrees in place, `team_tree` makes a team's tree of it or says what a team cannot carry out,
`export` writes.

It may import the core, and of the other formats `problems` and `limited_file`. A file may be
hostile: it is read within limits, or refused with file, line and node.
"""
