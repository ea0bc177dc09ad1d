"""What one who watches tells Prometheus of a team."""

from __future__ import annotations

from mrbt_mesh.runtime.metrics.team_page import team_page
from tests.support.metered import MeteredTeam, values


def page(*commands: str) -> dict[tuple[str, ...], float]:
    return values(team_page(MeteredTeam(*commands).observer))


def test_a_team_at_work() -> None:
    found = page()
    assert found["mrbt_team_robots", "alive"] == 3
    assert found["mrbt_team_robot_live", "A"] == 1
    assert found["mrbt_team_robot_working", "A", "weld"] == 1
    assert found["mrbt_team_agreement",] == found["mrbt_team_observer_caught_up",] == 1
    assert found["mrbt_team_mission_status", "running"] == 1
    assert found["mrbt_team_requests", "served"] == 1
    assert found["mrbt_team_global_tasks", "running"] == 1
    assert found["mrbt_team_faults", "major"] == found["mrbt_team_faults", "minor"] == 0


def test_a_takeover_has_its_durations() -> None:
    found = page("kill A", "pass 2000")
    assert found["mrbt_team_robots", "dead"] == 1
    assert found["mrbt_team_robot_live", "A"] == 0
    assert found["mrbt_team_faults", "major"] == 1
    assert found["mrbt_team_robot_working", "B", "weld"] == 1
    assert found["mrbt_team_detection_duration_seconds",] == 1
    assert found["mrbt_team_takeover_duration_seconds",] == 1


def test_outcomes_and_what_is_blocked() -> None:
    found = page("succeed A", "pass 300", "kill B", "pass 2000")
    assert found["mrbt_team_outcomes", "weld", "success"] == 1
    assert found["mrbt_team_requests", "blocked"] == 1
    assert found["mrbt_team_global_tasks", "success"] == 1
