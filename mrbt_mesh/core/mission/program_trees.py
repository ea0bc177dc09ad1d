"""Local tasks that are BehaviorTree.CPP trees: a mission holds their texts.

Robots' programs run them (`mrbt_mesh.btcpp`); nothing here reads their nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

_Pairs: TypeAlias = tuple[tuple[str, str], ...]


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
    ports: _Pairs = ()
    outputs: _Pairs = ()


@dataclass(frozen=True, slots=True)
class SharedTrees:
    """Trees with each document once: `files` holds (source, xml), sorted; `trees` has, by local
    task, the number of its file, `tree`, `ports` and `outputs`.
    """

    files: tuple[tuple[str, str], ...] = ()
    trees: Mapping[str, tuple[int, str, _Pairs, _Pairs]] = field(default_factory=dict)

    def trees_by_task(self) -> dict[str, ProgramTree]:
        """The trees themselves; raises ValueError if there is no file of a number."""
        numbers = range(len(self.files))
        for name, (number, *_) in self.trees.items():
            if number not in numbers:
                raise ValueError(f"tree of {name}: file {number}")
        return {
            name: ProgramTree(*self.files[number], tree, ports, outputs)
            for name, (number, tree, ports, outputs) in self.trees.items()
        }


def shared_trees(trees: Mapping[str, ProgramTree]) -> SharedTrees:
    """The same trees, with each document once."""
    files = sorted({(tree.source, tree.xml) for tree in trees.values()})
    numbers = {file: number for number, file in enumerate(files)}
    rows = {
        name: (numbers[tree.source, tree.xml], tree.tree, tree.ports, tree.outputs)
        for name, tree in trees.items()
    }
    return SharedTrees(tuple(files), rows)
