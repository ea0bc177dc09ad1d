"""T_A and T_Li of one robot: the statuses of their roots are those that the robot reports."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.viewmodel.own_trees import own_trees
from tests.support.watched import ALONE, watched


def observed(*commands: str) -> Observer:
    return watched(ALONE, *commands)[1]


def reported(observer: Observer, robot: str) -> tuple[int, ...]:
    beat = observer.membership.peers[robot].heartbeat
    assert beat is not None
    return beat.statuses


@pytest.mark.parametrize("robot", ["A", "C"])
def test_roots_are_what_the_robot_says_itself(robot: str) -> None:
    observer = observed()
    told = own_trees(observer, robot)
    _, assignment, _, local = reported(observer, robot)
    assert told["T_A"]["statuses"][0] == assignment
    assert told["T_Li"]["statuses"][0] == local


def test_the_branch_that_runs() -> None:
    told = own_trees(observed(), "A")["T_Li"]
    status = {
        row["subject"]: told["statuses"][i] for i, row in enumerate(told["tree"]) if row["subject"]
    }
    assert status["weld"] == Status.RUNNING
    assert status["lift"] == Status.IDLE
    assert status["assigned(weld)"] == Status.SUCCESS


def test_a_robot_that_is_not_known() -> None:
    with pytest.raises(KeyError):
        own_trees(observed(), "Z")
