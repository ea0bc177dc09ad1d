"""Places and paths of nodes."""

from __future__ import annotations

import random

import pytest

from mrbt_mesh.core.bt.tree import build_tree
from mrbt_mesh.formats.node_paths import child_path, root_path, walk
from tests.support.single_robot_trees import Grower


@pytest.mark.parametrize("seed", range(20))
def test_a_walk_places_every_node_of_a_tree_in_preorder(seed: int) -> None:
    tree = Grower(random.Random(seed)).tree()
    nodes = list(walk(tree))
    assert [node.spec.kind for node in nodes] == [node.kind for node in build_tree(tree).nodes]
    assert [node.place for node in nodes] == sorted(node.place for node in nodes)
    for node in nodes:
        spec, path = tree, root_path(tree)
        for position in node.place:
            spec, path = spec.children[position], child_path(path, spec, position)
        assert (spec, path) == (node.spec, node.path)
