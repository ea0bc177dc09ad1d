"""T_A and T_Li of one robot: the statuses of their roots are those that the robot reports."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import simulate
from mrbt_mesh.views.model.own_trees import RunningTree, own_trees, running_tree
from tests.support.paths import EXAMPLES
from tests.support.runs import run_example
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


def statuses_of(example: str, robot: str, until_us: int) -> dict[str, Status]:
    """Of the nodes of T_Li by what a view calls them."""
    result = run_example(example, 1, expect=None, timeout_us=until_us)
    told = own_trees(result.observer, robot)["T_Li"]
    rows = zip(told["tree"], told["statuses"], strict=True)
    return {row["label"]: Status(status) for row, status in reversed([*rows])}


def test_a_tree_is_seen_inside_below_its_branch() -> None:
    found = statuses_of("assembly", "R1", 200_000)
    assert found["assigned(fasten)"] == Status.SUCCESS
    assert found["Holding"] == Status.FAILURE
    assert found["Grasp"] == Status.RUNNING
    assert found["Turn(part={part})"] == Status.IDLE


def test_a_tree_that_the_robots_program_runs_is_seen_inside() -> None:
    assert statuses_of("inspection", "R1", 500_000)["Drive"] == Status.RUNNING
    later = statuses_of("inspection", "R1", 1_500_000)
    assert later["Drive"] == Status.SUCCESS
    assert later["ReadGauge(valve={valve}, pressure_bar={bar})"] == Status.RUNNING
    assert later["BackUp(distance_m=0.3)"] == Status.IDLE


def test_a_robot_that_is_not_known() -> None:
    with pytest.raises(KeyError):
        own_trees(observed(), "Z")


def running_trees(path: Path, robot: str) -> list[RunningTree]:
    """What a recording shows, one after the other, of the trees that a robot runs."""
    player, seen = Player(read_recording(path)), [RunningTree("", b"")]
    for record in player.recording.records:
        player.seek(record.at_us)
        running = running_tree(player.observer, robot)
        if running.statuses != seen[-1].statuses:
            seen.append(running)
    return seen


def test_the_trees_that_robots_run(tmp_path: Path) -> None:
    mission = load_mission(EXAMPLES / "inspection" / "mission.yaml")
    program = load_program(mission.program or "")
    result = simulate(mission, program, seed=3, record=tmp_path, timeout_us=60_000_000)
    assert result.summary["result"] == "success"
    for robot in result.summary["robots"]:
        own = running_trees(robot_file(tmp_path, robot), robot)
        watched = running_trees(observer_file(tmp_path), robot)
        # Whoever watches hears a tree with the next heartbeat, and sees nothing that was not.
        assert set(watched) <= set(own)
        assert len(watched) > 3
        assert own[-1].statuses == watched[-1].statuses == b"", "none runs after its local task"
