"""`mrbt tree convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.errors import InputError


def convert(
    source: Annotated[Path, argument("IN", "File to read (.xml or .yaml).")],
    target: Annotated[Path, argument("OUT", "File to write (.xml).")],
    compact: Annotated[bool, option("<Foo/> instead of <Action ID='Foo'/>.")] = False,
    merge: Annotated[bool, option("Put the trees of included files into OUT.")] = False,
    ids: Annotated[bool, option("As a monitor sees it: a tree per SubTree, with _uid.")] = False,
) -> None:
    """Write a tree as BehaviorTree.CPP 4 XML that Groot2 opens: explicit, with all models.

    Example: mrbt tree convert old_v3.xml new_v4.xml
    """
    from mrbt_mesh.cli.framework.terminal import console, errors, write_file
    from mrbt_mesh.cli.trees.converting import converted
    from mrbt_mesh.cli.views.finding_view import finding_line, line
    from mrbt_mesh.formats.btcpp.export import compact as compacted

    if target.suffix.lower() != ".xml":
        raise InputError(f"{target}: the file to write has to end in .xml")
    if ids and (merge or compact):
        raise InputError("--ids goes without --merge and --compact")
    document, found = converted(source, merge, ids)
    text = (compacted(document) if compact else document).text()
    for finding in found:
        errors.print(finding_line(finding), soft_wrap=True)
    write_file(target, text)
    trees = len(document.trees)
    count = f"{trees} tree{'s' if trees > 1 else ''}"
    console.print(line("written", "bold green", f"{target}: {count}"), soft_wrap=True)
