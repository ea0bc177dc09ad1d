"""The path of a node in a tree, and its name in explanations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from mrbt_mesh.core.bt.tree import NodeSpec


def label(spec: NodeSpec) -> str:
    """A child's name in explanations: its own, its leaf's, or its type with its first leaf."""
    if spec.name or spec.subject:
        return spec.name or spec.subject
    first = spec
    while first.children:
        first = first.children[0]
    return f"{spec.kind}({first.subject} ...)" if first is not spec else str(spec.kind)


def root_path(spec: NodeSpec) -> str:
    """The path of a tree's root."""
    return spec.name or spec.subject or str(spec.kind)


class Placed(NamedTuple):
    """A node of a tree. `place`: the positions of it and its ancestors among their siblings."""

    place: tuple[int, ...]
    path: str
    spec: NodeSpec


def walk(spec: NodeSpec) -> Iterator[Placed]:
    """All nodes of a tree, in preorder."""
    waiting = [Placed((), root_path(spec), spec)]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += [
            Placed((*node.place, position), child_path(node.path, node.spec, position), child)
            for position, child in reversed(list(enumerate(node.spec.children)))
        ]


def child_path(path: str, parent: NodeSpec, position: int) -> str:
    """`Sequence/Fallback[2]`: the type or name, and the place among siblings of inner nodes."""
    child = parent.children[position]
    part = root_path(child)
    if len(parent.children) > 1 and child.children:
        part += f"[{position + 1}]"
    return f"{path}/{part}"
