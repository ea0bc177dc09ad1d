"""A stranger shows liveliness tokens in robots' names and drops them: a keyed team works on."""

from __future__ import annotations

import signal

import pytest

from benchmarks.tokens import ROBOTS, deaths, stranger, write_mission
from mrbt_mesh.runtime.zenoh_transport import TOO_MANY_TOKENS
from tests.support.team import Team

# More than were under way when the stranger began: about a second's work of an idle machine.
STARTS = 30


def starts(team: Team) -> int:
    return sum(line["event"] == "start" for line in team.events())


@pytest.mark.parametrize(
    ("count", "names"),
    [
        (1_000, "mixed"),
        pytest.param(5_000, "mixed", marks=pytest.mark.slow),
        pytest.param(5_000, "live", marks=pytest.mark.slow),
        pytest.param(5_000, "lives", marks=pytest.mark.slow),
        pytest.param(5_000, "copies", marks=pytest.mark.slow),
    ],
)
def test_a_stranger_s_tokens_kill_nobody_and_keep_nobody_from_work(
    team: Team, count: int, names: str
) -> None:
    team.up(write_mission(team.folder))
    for robot in ROBOTS:
        team.wait_for_event("explore", robot=robot)
    with stranger("token_stranger", team.run_dir, str(count), names):
        before = starts(team)
        team.wait_until(lambda: starts(team) >= before + STARTS, "the team works on")
        if names != "copies":  # which nobody hears of while the robot shows its own
            team.wait_until(lambda: TOO_MANY_TOKENS in team.mrbt("status", "--json"), "it is shown")
        assert deaths(team.run_dir) == []
        # Who is dead is found all the same, if not at once.
        team.signal("R3", signal.SIGKILL)
        team.wait_until(lambda: {dead for _, dead in deaths(team.run_dir)} == {"R3"}, "R3 is dead")
