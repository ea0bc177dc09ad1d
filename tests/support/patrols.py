"""Simulated teams that patrol: half of the robots are at work, any of which could do anything."""

from __future__ import annotations

from collections import Counter

from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs
from tests.support.build import action, make_mission, parallel, task

MS = 1_000
GOOD = NetworkKnobs(link=LinkKnobs(delay_us=MS, jitter_us=MS), token_delay_us=5 * MS)
NO_TOKENS = NetworkKnobs(link=LinkKnobs(delay_us=MS, jitter_us=MS), token_delay_us=None)


def patrol(robots: int) -> Mission:
    """Half as many areas as robots, any of which can take any."""
    areas = [f"area{number}" for number in range(robots // 2)]
    tree = parallel(len(areas), *map(action, areas))
    able = {f"R{number:03d}": {"watch": 1.0} for number in range(robots)}
    return make_mission(tree, able, [task(area, ("watch", 1, 1)) for area in areas])


def started(robots: int, network: NetworkKnobs = GOOD, seed: int = 1) -> SteppedTeam:
    """A team that is at work, and has been for a while."""
    team = SteppedTeam(patrol(robots), network, seed)
    team.launch_all()
    team.run_until(20 * SECOND_US)
    assert alive(team) == {robots: robots}
    assert len(team.at_work()) == robots // 2
    return team


def alive(team: SteppedTeam) -> dict[int, int]:
    """How many robots hold how many for alive, themselves included."""
    return dict(Counter(len(agent.alive()) for agent in team.living()))
