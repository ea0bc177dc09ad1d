"""T_G's rows: folding, search, and what a row tells."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.sim import Kill
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.terminal.team import ShownTeam
from mrbt_mesh.views.terminal.tree_rows import FoldingTree
from tests.support.runs import run_example

SECOND = 1_000_000


def shown_at(until_s: float) -> ShownTeam:
    """The repair until then, A1 killed at 7 s."""
    until_us = round(until_s * SECOND)
    schedule = [(7 * SECOND, Kill("A1"))]
    result = run_example("vehicle_repair", 1, expect=None, schedule=schedule, timeout_us=until_us)
    shown = ShownTeam(TeamView(result.observer))
    shown.update(until_us)
    return shown


def labels(tree: FoldingTree, nodes: dict[int, list[Any]]) -> list[str]:
    return [tree.rows[index]["label"] for index, _ in tree.visible(nodes)]


def texts(tree: FoldingTree, nodes: dict[int, list[Any]]) -> list[str]:
    return [tree.text(index, depth, nodes).plain for index, depth in tree.visible(nodes)]


def test_a_large_tree_begins_with_what_does_not_run_folded() -> None:
    shown = shown_at(8.0)
    tree = FoldingTree(shown.mission["tree"])
    assert tree.folds_resting
    folded = labels(tree, shown.nodes)
    assert "diagnose_part(1)" in folded
    assert "solder(1)" not in folded
    tree.fold_resting(False)
    everything = labels(tree, shown.nodes)
    assert "solder(1)" in everything
    passed_over = sum(row["kind"] == "SubTree" for row in tree.rows)
    assert len(tree.rows) - passed_over <= len(everything) < len(tree.rows)


def test_a_row_tells_sign_robots_and_status() -> None:
    shown = shown_at(6.0)
    told = texts(FoldingTree(shown.mission["tree"]), shown.nodes)
    assert told[0] == "▾ ▶ Fallback  running"
    (diagnosing,) = (text for text in told if "diagnose_part(1)" in text)
    assert diagnosing.strip() == "▶ diagnose_part(1)  A1"
    assert any(text.strip().startswith("✔ remove_cover") for text in told)
    assert any(text.strip().startswith("▸ · fix ") for text in told), "folded, never ticked"


def test_what_is_activated_again_is_counted() -> None:
    nodes = {0: [int(Status.RUNNING), ["A"], "waits", 3]}
    row = {"kind": "Action", "label": "weld", "subject": "weld", "parent": -1}
    assert FoldingTree([row]).text(0, 0, nodes).plain == "  ▶ weld  A  waits  ×3"


def test_folding_by_hand_goes_before_the_rule() -> None:
    shown = shown_at(6.0)
    tree = FoldingTree(shown.mission["tree"])
    tree.fold(0, True)
    assert labels(tree, shown.nodes) == ["Fallback"]
    tree.fold(0, False)
    leaf = next(i for i, row in enumerate(tree.rows) if row["label"] == "solder(1)")
    tree.fold(leaf, True)
    assert not tree.is_folded(leaf, shown.nodes), "there is nothing below a leaf"


def test_search_finds_what_is_folded_and_goes_round() -> None:
    shown = shown_at(6.0)
    tree = FoldingTree(shown.mission["tree"])
    first = tree.find("SOLDER(", -1)
    assert first is not None
    assert tree.rows[first]["label"] == "solder(1)"
    assert "solder(1)" not in labels(tree, shown.nodes)
    tree.reveal(first)
    assert "solder(1)" in labels(tree, shown.nodes)
    found = [first]
    while (after := tree.find("solder(", found[-1])) != first:
        assert after is not None
        found.append(after)
    assert [tree.rows[i]["label"] for i in found] == [f"solder({n})" for n in range(1, 6)]
    assert tree.find("solder(", first, -1) == found[-1]
    assert tree.find("no such node", -1) is None


def test_every_row_that_is_shown_hangs_below_its_parent() -> None:
    shown = shown_at(6.0)
    tree = FoldingTree(shown.mission["tree"])
    tree.fold_resting(False)
    depths = dict(tree.visible(shown.nodes))
    for index, depth in depths.items():
        above = tree.parent(index)
        assert (above == -1) if depth == 0 else depths[above] == depth - 1
