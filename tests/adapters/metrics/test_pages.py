"""The metrics of a robot, and of a team."""

from __future__ import annotations

import pytest

from mrbt_mesh.adapters.metrics.pages import robot_page, team_page
from mrbt_mesh.core.facts.records import JOURNAL
from mrbt_mesh.runtime.journal_writer import SLOW
from tests.support.metered import MeteredTeam, values


def page(*commands: str) -> dict[tuple[str, ...], float]:
    team = MeteredTeam(*commands)
    return values(robot_page(team.view, team.meter))


def test_a_team_at_work() -> None:
    found = page()
    assert found["mrbt_joined",] == found["mrbt_agreement",] == 1
    assert found["mrbt_mission_status", "running"] == 1
    assert found["mrbt_requests", "served"] == 1
    assert found["mrbt_peers", "alive"] == 2
    assert found["mrbt_peer_dead", "B"] == found["mrbt_peer_dead", "C"] == 0
    assert found["mrbt_local_task_running_seconds", "weld"] >= 0
    assert found["mrbt_claims", "weld", "running"] == 1
    assert found["mrbt_received_bytes", "heartbeat"] > found["mrbt_received_messages", "heartbeat"]
    assert found["mrbt_facts",] > 3
    assert ("mrbt_peer_dead", "A") not in found


def test_a_death_and_a_request_that_cannot_be_served() -> None:
    found = page("succeed A", "pass 300", "kill B", "pass 2000")
    assert found["mrbt_peers", "dead"] == found["mrbt_peer_dead", "B"] == 1
    assert found["mrbt_deaths_declared", "B"] == found["mrbt_suspicions", "B"] == 1
    assert found["mrbt_requests", "blocked"] == 1
    assert found["mrbt_requests", "served"] == 0
    assert found["mrbt_outcomes", "weld", "success"] == 1


def test_a_robot_without_work_has_no_sample_of_a_running_task() -> None:
    found = page("succeed A", "pass 300", "succeed A", "succeed B", "pass 300")
    assert found["mrbt_mission_status", "success"] == 1
    assert not [key for key in found if key[0] == "mrbt_local_task_running_seconds"]


def test_a_lost_capability() -> None:
    assert page("tell A fault weld", "pass 100")["mrbt_lost_capabilities",] == 1


@pytest.mark.parametrize(
    ("problem", "reason"),
    [
        ("journal cannot be written: No space left on device", "disk_full"),
        ("journal cannot be written: it is read-only", "other"),
        (SLOW, "slow"),
    ],
)
def test_a_problem_of_the_journal(problem: str, reason: str) -> None:
    team = MeteredTeam()
    team.view.facts.problems["A"] = {JOURNAL: problem}
    found = values(robot_page(team.view, team.meter))
    names = ("disk_full", "slow", "other")
    assert [n for n in names if found["mrbt_journal_problem", n]] == [reason]


def test_the_names_are_those_that_prometheus_asks_for() -> None:
    team = MeteredTeam()
    names = [family.name for family in robot_page(team.view, team.meter)]
    assert len(names) == len(set(names))
    for name in names:
        assert name.startswith("mrbt_")
        assert not name.endswith(("_total", "_info", "_count", "_sum", "_bucket", "_ms", "_us"))


def observed(*commands: str) -> dict[tuple[str, ...], float]:
    return values(team_page(MeteredTeam(*commands).observer))


def test_an_observed_team_at_work() -> None:
    found = observed()
    assert found["mrbt_team_robots", "alive"] == 3
    assert found["mrbt_team_robot_live", "A"] == 1
    assert found["mrbt_team_robot_working", "A", "weld"] == 1
    assert found["mrbt_team_agreement",] == found["mrbt_team_observer_caught_up",] == 1
    assert found["mrbt_team_mission_status", "running"] == 1
    assert found["mrbt_team_requests", "served"] == 1
    assert found["mrbt_team_global_tasks", "running"] == 1
    assert found["mrbt_team_faults", "major"] == found["mrbt_team_faults", "minor"] == 0


def test_a_takeover_has_its_durations() -> None:
    found = observed("kill A", "pass 2000")
    assert found["mrbt_team_robots", "dead"] == 1
    assert found["mrbt_team_robot_live", "A"] == 0
    assert found["mrbt_team_faults", "major"] == 1
    assert found["mrbt_team_robot_working", "B", "weld"] == 1
    assert found["mrbt_team_detection_duration_seconds",] == 1
    assert found["mrbt_team_takeover_duration_seconds",] == 1


def test_outcomes_and_what_is_blocked() -> None:
    found = observed("succeed A", "pass 300", "kill B", "pass 2000")
    assert found["mrbt_team_outcomes", "weld", "success"] == 1
    assert found["mrbt_team_requests", "blocked"] == 1
    assert found["mrbt_team_global_tasks", "success"] == 1
