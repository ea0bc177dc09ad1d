"""BehaviorTree.CPP v4 XML: reading, checking, writing.

`xml_reader`, `elements` and `document` read a file without loss and interpret its parts. `upgrade`
converts version 3, `library` follows includes, and `check` checks the rules. `expand` inlines
SubTrees, and `export` writes. A file may be hostile: it is read within limits, or refused with
file, line and node.
"""
