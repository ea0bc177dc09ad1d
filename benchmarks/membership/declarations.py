"""Declarations of death by the agents, and by a plain detector that sees the same heartbeats."""

from __future__ import annotations

import random
from dataclasses import dataclass, field, fields

from benchmarks.membership.networks import SECOND_US, TIMING, WARM_UP_US, Net, mission, name
from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.sim.world.network import Link


@dataclass
class Declarations:
    """Of both detectors, on one kind of network, over some runs of one team size."""

    minutes: float = 0.0
    false: int = 0
    plain_false: int = 0
    detection_us: list[int] = field(default_factory=list)
    plain_detection_us: list[int] = field(default_factory=list)

    def add(self, other: Declarations) -> None:
        for each in fields(self):
            setattr(self, each.name, getattr(self, each.name) + getattr(other, each.name))


class Watch:
    """Follows both detectors of every robot while a team runs."""

    def __init__(self, team: SteppedTeam) -> None:
        self.team = team
        self.found = Declarations()
        self._timing = TIMING.of_team(len(team.mission.robots))
        self._seen: dict[str, int] = {}
        self._dead: set[Link] = set()
        self._beat_us: dict[Link, int] = {}
        self._frozen_us: dict[str, int] = {}
        team.on_step = self._step
        team.on_beat = self._beat

    def _step(self, agent: AgentView, now_us: int) -> None:
        _, changes = agent.version
        if self._seen.get(agent.robot) == changes:
            return
        self._seen[agent.robot] = changes
        for robot, peer in agent.peers.items():
            pair = (robot, agent.robot)
            if peer.state is not State.DEAD:
                self._dead.discard(pair)
            elif pair not in self._dead:
                self._dead.add(pair)
                if robot in self._frozen_us:
                    self.found.detection_us.append(now_us - self._frozen_us[robot])
                else:
                    self.found.false += 1

    def _beat(self, source: str, target: str, now_us: int) -> None:
        if not self.team.agent(target).judges(source):
            return
        silent_us = now_us - self._beat_us.get((source, target), now_us)
        self.found.plain_false += silent_us >= self._timing.detection_us
        self._beat_us[source, target] = now_us

    def freeze(self, robot: str) -> None:
        self._frozen_us[robot] = self.team.now_us
        self.team.freeze(robot)

    def close(self) -> Declarations:
        """The plain detector's times follow from the last beat that each robot received."""
        silent = set(self.team.network.blocked)
        for (source, target), last_us in self._beat_us.items():
            due_us = last_us + self._timing.detection_us
            if (source, target) in silent:
                self.found.plain_false += source not in self._frozen_us  # and for ever
            elif source in self._frozen_us and target not in self._frozen_us:
                # A robot that was declared dead before the freeze is found at once.
                self.found.plain_detection_us.append(max(0, due_us - self._frozen_us[source]))
        return self.found


def declarations(robots: int, net: Net, rest_s: int, victims: int, seed: int) -> Declarations:
    """A team at rest for a while; then some robots freeze, one after the other."""
    team = SteppedTeam(mission(robots, 1), net.knobs(), seed, is_shared=True)
    watch = Watch(team)
    choose, timing = random.Random(f"victims/{seed}"), TIMING.of_team(robots)
    team.launch_all()
    team.run_until(min(WARM_UP_US, rest_s * SECOND_US))
    team.network.block(net.blocked())
    team.run_until(rest_s * SECOND_US)
    watch.found.minutes = rest_s / 60
    # Of three robots, the third that the ends of a broken link have to ask must stay.
    candidates = range(1) if net.links and robots == 3 else range(robots)
    for victim in choose.sample(candidates, victims):
        team.run_until(team.now_us + choose.randrange(timing.heartbeat_us))
        watch.freeze(name(victim))
        team.run_until(team.now_us + timing.max_detection_us + SECOND_US)
    return watch.close()
