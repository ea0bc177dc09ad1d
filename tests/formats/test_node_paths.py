"""Paths of nodes."""

from __future__ import annotations

from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.formats.node_paths import child_path, root_path
from tests.support.build import action


def test_a_path_has_names_and_the_places_of_inner_nodes_among_siblings() -> None:
    inner = NodeSpec(Kind.FALLBACK, (action("a"), action("b")))
    lone = NodeSpec(Kind.SEQUENCE, (inner,), name="top")
    both = NodeSpec(Kind.SEQUENCE, (action("a"), inner))
    assert root_path(lone) == "top"
    assert child_path("top", lone, 0) == "top/Fallback"
    assert [child_path("Sequence", both, n) for n in (0, 1)] == [
        "Sequence/a",
        "Sequence/Fallback[2]",
    ]
