"""New teams with real processes: one of their robots is killed."""

from __future__ import annotations

import signal

import pytest

from tests.support.paths import EXAMPLES
from tests.support.team import Team


@pytest.mark.parametrize(
    ("local_task", "words"),
    [
        ("carry", ("new",)),
        pytest.param(
            "Visit",
            ("tree", "lift", str(EXAMPLES / "robot_trees" / "nav2" / "patrol.xml")),
            marks=pytest.mark.slow,
        ),
    ],
    ids=["a driver in Python", "a tree of one robot"],
)
def test_a_robot_of_a_new_team_is_killed_and_replaced(
    team: Team, local_task: str, words: tuple[str, ...]
) -> None:
    folder = team.folder / "mine"
    team.mrbt(*words, str(folder))
    team.up(folder / "mission.yaml", speed=2)
    victim = team.wait_for_work(team.wait_for_event(local_task))
    team.signal(victim["robot"], signal.SIGKILL)
    assert team.wait_for_replacement(victim)["robot"] != victim["robot"]
    code, summary = team.end()
    assert code == 0, team.logs()
    assert victim["robot"] in [fault["robot"] for fault in summary["faults"]]
