"""The path of a node in a tree."""

from __future__ import annotations

from mrbt_mesh.core.bt.tree import NodeSpec


def root_path(spec: NodeSpec) -> str:
    """The path of a tree's root."""
    return spec.name or spec.subject or str(spec.kind)


def child_path(path: str, parent: NodeSpec, position: int) -> str:
    """Return a child's path, e.g. `Sequence/Fallback[2]`.

    A part is the name, subject or type of a node, with its place among siblings for inner nodes.
    """
    child = parent.children[position]
    part = root_path(child)
    if len(parent.children) > 1 and child.children:
        part += f"[{position + 1}]"
    return f"{path}/{part}"
