"""Random trees: without marks one robot does all; with marks nothing else is spread."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from mrbt_mesh.analysis.lift.folder import Lifted
from mrbt_mesh.btcpp.files.document import LEAVES
from mrbt_mesh.errors import FileError
from mrbt_mesh.sim import Kill
from tests.support.effort import at_size
from tests.support.marked_trees import MarkedGrower, Story, alone, lifted, run_lifted

SEEDS = at_size(quick=range(8), gate=range(100))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tree_without_marks_ends_as_the_single_robots(seed: int, tmp_path: Path) -> None:
    text = MarkedGrower(random.Random(seed)).document()
    single, team = Story(seed), Story(seed)
    expected = alone(text, single)
    assert [use.call for use in lifted(text, tmp_path).uses] == ["Main"]
    result = run_lifted(tmp_path, team)
    assert (result.result, team.log) == (expected.replace("error", "failure"), single.log)


@pytest.mark.parametrize("seed", SEEDS)
def test_whoever_takes_over_begins_anew(seed: int, tmp_path: Path) -> None:
    """Leaves end as they do each time: a robot that dies changes nothing of the result."""
    text = MarkedGrower(random.Random(seed)).document()
    single, team = Story(seed, by_turn=False), Story(seed, by_turn=False)
    expected = alone(text, single)
    lifted(text, tmp_path)
    done = single.log
    result = run_lifted(tmp_path, team, [(700_000, Kill("R1"))])
    assert result.result == expected.replace("error", "failure")
    before = len(team.log) - len(done)
    assert team.log == done[:before] + done, "from the beginning"


@pytest.mark.parametrize("seed", at_size(quick=range(20), gate=range(300)))
def test_a_marked_tree_does_the_same_one_after_the_other(seed: int, tmp_path: Path) -> None:
    text = MarkedGrower(random.Random(seed), marks=2).document()
    single, team = Story(seed), Story(seed)
    expected = alone(text, single)
    found = lifted_or_none(text, tmp_path)
    if found is None or expected == "error":
        return
    check_spread(found)
    result = run_lifted(tmp_path, team)
    assert (result.result, team.log) == (expected, single.log)


@pytest.mark.parametrize("seed", at_size(quick=range(20), gate=range(300)))
def test_a_parallel_tree_ends_as_the_single_robots(seed: int, tmp_path: Path) -> None:
    text = MarkedGrower(random.Random(seed), marks=1, parallel=True).document()
    single, team = Story(seed, by_turn=False), Story(seed, by_turn=False)
    expected = alone(text, single)
    found = lifted_or_none(text, tmp_path)
    if found is None or expected == "error":
        return
    check_spread(found)
    assert run_lifted(tmp_path, team).result == expected


def lifted_or_none(text: str, folder: Path) -> Lifted | None:
    try:
        return lifted(text, folder)
    except FileError:
        return None


def check_spread(found: Lifted) -> None:
    """Each leaf is in one task; only a task's top is marked, and neighbours of one are not."""
    tops = [node for use in found.uses for node in use.piece.nodes]
    leaves = [id(node) for top in tops for node in top.walk() if node.category in LEAVES]
    assert len(leaves) == len(set(leaves))
    for use in found.uses:
        nodes = use.piece.nodes
        below = [node for top in nodes for node in top.walk() if node is not top]
        assert not any("_team" in n.metadata or "_parallel" in n.metadata for n in below)
        assert len(nodes) == 1 or not any("_team" in top.metadata for top in nodes)
