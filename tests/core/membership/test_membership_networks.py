"""Nobody is thought dead who lives, however bad the network; who dies is found in time.

Reduced; benchmarks/membership measures the rest.
"""

from __future__ import annotations

import random
from collections.abc import Iterable

import pytest

from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.sim.world.network import Link, LinkKnobs, NetworkKnobs
from tests.support import build

SECOND_US = 1_000_000
TIMING = Timing()


def started(
    robots: int,
    seed: int,
    *,
    loss: int = 0,
    jitter_us: int = 1_000,
    reorder: int = 0,
    tokens: bool = False,
) -> SteppedTeam:
    """A team at rest; loss in permille."""
    names = {f"R{i:02d}": {"work": 1.0} for i in range(robots)}
    tree = build.keep_running(build.fallback(build.condition("idle"), build.action("work")))
    mission = build.make_mission(tree, names, [build.task("work", ("work", 1, 1))])
    link = LinkKnobs(
        jitter_us=jitter_us, loss_permille=loss, reorder_permille=reorder, reorder_us=200_000
    )
    knobs = NetworkKnobs(link, token_delay_us=5_000 if tokens else None)
    found = SteppedTeam(mission, knobs, seed)
    found.launch_all()
    return found


class Declarations:
    """Who holds whom for dead, and since when; `of_living` counts the false ones."""

    def __init__(self, watched: SteppedTeam) -> None:
        self.team = watched
        self.of_living: list[str] = []
        self.since_us: dict[Link, int] = {}
        watched.on_step = self._step

    def _step(self, agent: AgentView, now_us: int) -> None:
        for robot, peer in agent.peers.items():
            pair = (agent.robot, robot)
            if peer.state is not State.DEAD:
                self.since_us.pop(pair, None)
            elif pair not in self.since_us:
                self.since_us[pair] = now_us
                if self.team.runs(robot):
                    self.of_living.append(f"{pair[0]} takes {robot} for dead at {now_us} us")


def pairs(*links: str) -> list[Link]:
    """`"0>1"` is one direction, `"0-1"` both."""
    found = []
    for link in links:
        one, other = f"R0{link[0]}", f"R0{link[2]}"
        found += [(one, other)] + [(other, one)] * (link[1] == "-")
    return found


NETWORKS = [
    pytest.param({"loss": 300}, (), id="loss"),
    pytest.param({"jitter_us": 200_000}, (), id="jitter"),
    pytest.param({"loss": 300, "jitter_us": 200_000}, (), id="loss+jitter"),
    pytest.param({"loss": 300, "reorder": 500}, (), id="loss+reordering"),
    pytest.param({}, ("0>1",), id="one-way"),
    pytest.param({}, ("0-1",), id="broken"),
    pytest.param({"loss": 300, "jitter_us": 200_000}, ("0>1",), id="loss+jitter+one-way"),
    pytest.param({"loss": 300, "jitter_us": 200_000}, ("0-1",), id="loss+jitter+broken"),
    pytest.param({"loss": 300}, ("0>1", "1>2", "2>0"), id="loss+one-way-ring"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("knobs", "blocked"), NETWORKS)
@pytest.mark.parametrize("robots", [3, 6])
def test_no_living_robot_is_thought_dead(
    knobs: dict[str, int], blocked: Iterable[str], robots: int
) -> None:
    """All the links are there at first; those that break do so while the team is at rest."""
    for seed in range(3 if robots == 3 else 1):
        team = started(robots, seed, **knobs)
        declarations = Declarations(team)
        team.run_until(10 * SECOND_US)
        team.network.block(pairs(*blocked))
        team.run_until(60 * SECOND_US)
        assert not declarations.of_living, f"seed {seed}: {declarations.of_living}"
        assert not any(agent.is_joining for agent in team.living()), f"seed {seed}"


def test_the_more_is_lost_the_more_patient_robots_become() -> None:
    """Three robots, two of them without a link, and four beats of ten lost: with the detection
    time of a good network, some of these runs have false declarations.
    """
    for seed in range(6):
        team = started(3, seed, loss=400, jitter_us=200_000)
        declarations = Declarations(team)
        team.run_until(10 * SECOND_US)
        team.network.block(pairs("0-1"))
        team.run_until(100 * SECOND_US)
        assert not declarations.of_living, f"seed {seed}: {declarations.of_living}"


def found_dead_us(team: SteppedTeam, victim: str, at_us: int) -> list[int]:
    """After how long each of the others has declared a victim dead."""
    declarations = Declarations(team)
    team.run_until(at_us)
    team.freeze(victim)
    team.run_until(at_us + TIMING.max_detection_us)
    assert not declarations.of_living
    return sorted(us - at_us for (_, robot), us in declarations.since_us.items() if robot == victim)


@pytest.mark.parametrize("robots", [2, 3, 6])
def test_on_a_good_network_a_frozen_robot_is_found_in_the_detection_time(robots: int) -> None:
    for seed in range(4):
        at_us = 5 * SECOND_US + random.Random(seed).randrange(TIMING.heartbeat_us)
        found_us = found_dead_us(started(robots, seed), "R01", at_us)
        assert len(found_us) == robots - 1, f"seed {seed}"
        assert found_us[-1] <= TIMING.detection_us + 5_000, f"seed {seed}"
        assert found_us[0] > TIMING.detection_us - TIMING.heartbeat_us, f"seed {seed}"


@pytest.mark.parametrize("robots", [3, 6])
def test_on_a_bad_network_a_frozen_robot_is_found_in_the_longest_time(robots: int) -> None:
    for seed in range(4):
        team = started(robots, seed, loss=300, jitter_us=200_000)
        found_us = found_dead_us(team, "R01", 20 * SECOND_US)
        assert len(found_us) == robots - 1, f"seed {seed}"
        assert found_us[-1] <= TIMING.max_silence_us, f"seed {seed}"
