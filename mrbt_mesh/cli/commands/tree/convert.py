"""`mrbt tree convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.errors import InputError


def convert(
    source: Annotated[Path, argument("IN", "File (.xml or .yaml) or folder to read.")],
    target: Annotated[Path, argument("OUT", "File (.xml) or folder to write.")],
    compact: Annotated[bool, option("<Foo/> instead of <Action ID='Foo'/>.")] = False,
    merge: Annotated[bool, option("Put the trees of included files into OUT.")] = False,
    ids: Annotated[bool, option("As a monitor sees it: a tree per SubTree, with _uid.")] = False,
) -> None:
    """Write trees as BehaviorTree.CPP 4.7 to 4.10 loads them and Groot2 opens them.

    The explicit form with all models; a whole folder at once, too.

    Example: mrbt tree convert old_v3.xml new_v4.xml
    """
    from mrbt_mesh.cli.trees.converting import Wanted, convert_file, convert_folder

    if ids and (merge or compact):
        raise InputError("--ids goes without --merge and --compact")
    write = convert_folder if source.is_dir() else convert_file
    write(source, target, Wanted(compact, merge, ids))
