"""Local tasks that are trees, on real processes: a robot is killed in the middle of one."""

from __future__ import annotations

import signal

import pytest

from mrbt_mesh.drills.physical import spans
from tests.support.paths import mission_file
from tests.support.team import TEST_TIMEOUT_S, Team

pytestmark = [pytest.mark.processes, pytest.mark.timeout(TEST_TIMEOUT_S)]


def test_a_tree_is_ticked_by_its_robot_and_begun_anew_by_another(team: Team) -> None:
    team.hold("turn")
    team.up(mission_file("assembly"))
    victim = team.wait_for_event("turn")
    team.signal(victim["robot"], signal.SIGKILL)
    team.wait_for_line(f"{victim['robot']} is dead")
    team.release()
    code, _ = team.end()
    assert code == 0, team.logs()
    done = spans(team.events())
    turned = [s.part for s in done if s.local_task == "turn" and s.end == "success"]
    assert sorted(turned) == ["1", "2", "3"]
    # The tool slipped at part 2: that was cancelled, and the tool taken up again.
    (survivor,) = {"R1", "R2"} - {victim["robot"]}
    slipped = next(s for s in done if s.end == "cancel" and s.robot == survivor)
    again = [s for s in done if s.robot == survivor and s.start_s >= slipped.end_s]
    assert (slipped.local_task, slipped.part) == ("turn", "2")
    assert [again[0].local_task, again[1].local_task] == ["grasp", "turn"]
