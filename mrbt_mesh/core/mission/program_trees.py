"""Local tasks that are BehaviorTree.CPP trees: a mission holds their texts.

Robots' programs run them (`mrbt_mesh.btcpp`); nothing here reads their nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ProgramTree:
    """The tree of one ground local task.

    `xml`: one document with all that its file includes; `tree`: the ID in it. `ports`: entries of
    the root blackboard, set before the first tick. `outputs`: conditions of the team by the
    entries whose truth they get when the tree has ended. `source` is for messages.
    """

    source: str
    xml: str
    tree: str
    ports: tuple[tuple[str, str], ...] = ()
    outputs: tuple[tuple[str, str], ...] = ()


def program_trees_to_json(trees: Mapping[str, ProgramTree]) -> dict[str, Any]:
    """As plain data: each document once."""
    files = sorted({(tree.source, tree.xml) for tree in trees.values()})
    numbers = {file: number for number, file in enumerate(files)}
    return {
        "files": [list(file) for file in files],
        "trees": {
            name: [
                numbers[tree.source, tree.xml],
                tree.tree,
                [list(pair) for pair in tree.ports],
                [list(pair) for pair in tree.outputs],
            ]
            for name, tree in trees.items()
        },
    }


def program_trees_from_json(data: Mapping[str, Any]) -> dict[str, ProgramTree]:
    """The inverse; raises TypeError for anything else."""
    found = {}
    try:
        for name, (number, tree, ports, outputs) in sorted(data.get("trees", {}).items()):
            source, xml = data["files"][number]
            pairs = [tuple((key, value) for key, value in each) for each in (ports, outputs)]
            found[name] = ProgramTree(source, xml, tree, *pairs)
    except (LookupError, ValueError, AttributeError) as error:
        raise TypeError(f"trees of programs: {error}") from None
    for each in found.values():
        texts = [each.source, each.xml, each.tree]
        texts += [text for pair in each.ports + each.outputs for text in pair]
        if not all(isinstance(text, str) for text in texts):
            raise TypeError("trees of programs are of texts")
    return found
