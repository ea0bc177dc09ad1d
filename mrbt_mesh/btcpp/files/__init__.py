"""BehaviorTree.CPP v4 XML: reading, checking, writing.

`xml_reader`, `elements`, `document`: a file as data, without loss, and what its parts mean.
`upgrade` (version 3), `library` (includes), `check` (the rules). `expand` puts SubTrees in place,
`export` writes. A file may be hostile: it is read within limits, or refused with file, line and
node.
"""
