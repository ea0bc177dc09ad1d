"""T_i of a robot as rows: its parts are those that the view model tells, in one tree."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.own_trees import own_trees
from mrbt_mesh.views.terminal.tree_rows import FoldingTree, RobotRows
from tests.support.runs import run_example
from tests.support.watched import ALONE, watched

SECOND = 1_000_000
REPORTED = ("running", "success", "running", "failure")


def observed(*commands: str) -> Observer:
    return watched(ALONE, *commands)[1]


def test_every_node_of_both_trees_has_its_status_and_its_place() -> None:
    observer = observed()
    own = RobotRows(observer, "A")
    nodes, told = own.nodes(REPORTED), own_trees(observer, "A")
    assert [row["label"].partition(",")[0] for row in own.rows if row["parent"] == 0] == [
        *("T_A", "T_G", "T_Li")
    ]
    at = 1
    for part in ("T_A", "T_Li"):
        tree, statuses = told[part]["tree"], told[part]["statuses"]
        assert own.rows[at]["label"].startswith(part)
        for index, (row, status) in enumerate(zip(tree, statuses, strict=True)):
            assert nodes[at + index][0] == status
            if index:
                assert own.rows[at + index]["label"] == row["label"]
                assert own.rows[at + index]["parent"] == at + row["parent"]
        at += len(tree) + 1
    assert at == len(own.rows) + 1
    assert set(nodes) == set(range(len(own.rows)))
    assert len(FoldingTree(own.rows).visible(nodes)) == len(own.rows)


def test_what_the_robot_reports_of_the_whole_and_of_the_team() -> None:
    own = RobotRows(observed(), "A")
    of_team = next(i for i, row in enumerate(own.rows) if row["label"].startswith("T_G"))
    nodes = own.nodes(("failure", "success", "success", "running"))
    assert (nodes[0][0], nodes[of_team][0]) == (Status.FAILURE, Status.SUCCESS)
    silent = own.nodes(())
    assert (silent[0][0], silent[of_team][0]) == (Status.IDLE, Status.IDLE)


def test_a_robot_that_describes_itself_anew_has_another_tree() -> None:
    script, observer = watched(ALONE)
    own = RobotRows(observer, "A")
    script.block(["pass 300"])
    assert own.is_of(observer)
    assert not own.is_of(observed()), "another observer, as after a step back in a recording"
    assert "lift" in [row["label"] for row in own.rows]
    # As if another program had been started under its name.
    known = observer.facts.members["A"]
    member = replace(known.member, capabilities={"weld": 1_000_000})
    observer.facts.members["A"] = known._replace(member=member)
    assert not own.is_of(observer)
    assert "lift" not in [row["label"] for row in RobotRows(observer, "A").rows]


def test_the_trees_that_its_program_runs_stand_below_their_local_tasks() -> None:
    result = run_example("inspection", 1, expect=None, timeout_us=SECOND // 2)
    own, told = RobotRows(result.observer, "R1"), own_trees(result.observer, "R1")["T_Li"]
    labels = [row["label"] for row in own.rows[-len(told["tree"]) :]]
    assert labels[1:] == [row["label"] for row in told["tree"]][1:]
    assert labels[-1] == "Script(code=too_high := bar > limit_bar)"
    nodes = own.nodes(REPORTED)
    assert [nodes[index][0] for index in sorted(nodes)][-len(labels) :] == told["statuses"]
    (inspect,) = (i for i, row in enumerate(own.rows) if row["label"] == "inspect")
    assert nodes[inspect][0] == Status.RUNNING
