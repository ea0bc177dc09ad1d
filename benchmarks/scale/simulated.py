"""Teams of 8 to 1,000 robots in virtual time: the real agents, what they send, and how soon.

A patrol: up to 32 areas, in each of which one robot is at work; the others are free. One event
after the other befalls the team. Robots come round every 10 ms and messages take 1 ms, so that what
takes time is the protocol. Planning takes none: docs/data/performance.md has its times.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path

from benchmarks.membership.team import SteppedTeam
from benchmarks.missions import write_patrol
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.world.network import Link, LinkKnobs, NetworkKnobs

# Of larger teams one event of each kind; of still larger ones no facts, joins and partitions.
MOST_WITH_ALL_EVENTS, MOST_TOLD_WHOLE = 125, 250
MOST_AREAS = 32
FACTS_PER_ROBOT = 10
ROUND_US, DELAY_US = 10_000, 1_000
SETTLE_US, REST_US, WINDOW_US = 4 * SECOND_US, 4 * SECOND_US, 4 * SECOND_US
GIVE_UP_US = 60 * SECOND_US


@dataclass
class Event:
    """What one kind of event brought, once or several times over.

    `most` and `mean`: messages that a robot received beyond what it does at rest, of all robots the
    most, and on average; `kb` likewise sent. `replaced_s`: until another robot was at work.
    """

    most: list[float] = field(default_factory=list)
    mean: list[float] = field(default_factory=list)
    kb: list[float] = field(default_factory=list)
    replaced_s: list[float] = field(default_factory=list)


@dataclass
class Size:
    """What was found of one team; None: not in time. `cpu_s`: what its simulation took."""

    robots: int
    launch_s: float | None = None
    launch_most: int = 0
    rest_messages: float = 0.0
    rest_bytes: float = 0.0
    events: dict[str, Event] = field(default_factory=dict)
    facts: int = 0
    facts_s: float | None = None
    late_s: float | None = None
    late_kb: float = 0.0
    cut_s: float | None = None
    healed_s: float | None = None
    cpu_s: float = 0.0


@cache
def patrol(robots: int) -> Mission:
    """A team with a condition for each fact that is to be seen."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        return load_mission(
            write_patrol(
                Path(folder),
                [f"R{robot:04}" for robot in range(robots)],
                [f"a{area:02}" for area in range(min(robots // 2, MOST_AREAS))],
                cells=[f"c{cell:05}" for cell in range(FACTS_PER_ROBOT * robots)],
            )
        )


class Story:
    """One team, and what befalls it. The same seed gives the same story."""

    def __init__(self, robots: int, seed: int = 1) -> None:
        self.found = Size(robots)
        self.mission = patrol(robots)
        network = NetworkKnobs(LinkKnobs(delay_us=DELAY_US, jitter_us=0))
        self.team = SteppedTeam(self.mission, network, seed, round_us=ROUND_US, is_shared=True)
        self._areas = len([*self.mission.tree.actions()])
        self._begun_s = time.process_time()

    def tell(self, events: int, is_whole: bool) -> Size:
        """Everything; `events` of each kind. Without `is_whole` no facts, joins and partitions."""
        self._launch()
        self._rest()
        for _ in range(events):
            for kind, befall, mend in (
                ("outcome", self.team.end_action, None),
                ("new plan", self._lose, partial(self._lose, lost=False)),
                ("kill", self.team.kill, self.team.launch),
                ("freeze", self.team.freeze, self.team.thaw),
            ):
                victim = self._event(kind, befall)
                if mend is not None:
                    mend(victim)
                    self.team.run_until(self.team.now_us + SETTLE_US)
        if is_whole:
            self._see()
            self._join()
            self._cut()
        self.found.cpu_s = round(time.process_time() - self._begun_s, 1)
        return self.found

    def _until(self, is_so: Callable[[], bool], at_most_us: int = GIVE_UP_US) -> float | None:
        """Seconds until something is so; None: it was not, in time."""
        begun_us = self.team.now_us
        while not is_so():
            if self.team.now_us >= begun_us + at_most_us:
                return None
            self.team.run_until(self.team.now_us + ROUND_US)
        return (self.team.now_us - begun_us) / SECOND_US

    def _launch(self) -> None:
        self.team.launch_all()
        self.found.launch_s = self._until(lambda: len(self.team.at_work()) == self._areas)
        self.found.launch_most = max(self.team.received.values())
        self.team.run_until(self.team.now_us + SETTLE_US)

    def _rest(self) -> None:
        team, found = self.team, self.found
        sent, sent_bytes = team.sent, team.sent_bytes
        team.run_until(team.now_us + REST_US)
        scale = found.robots * REST_US / SECOND_US
        found.rest_messages = (team.sent - sent) / scale
        found.rest_bytes = (team.sent_bytes - sent_bytes) / scale

    # -- events -------------------------------------------------------------------------------

    def _lose(self, robot: str, lost: bool = True) -> None:
        self.team.give(robot, CapabilityChanged("explore", lost=lost))

    def _event(self, kind: str, befall: Callable[[str], None]) -> str:
        """It befalls a robot at work, which is returned; what comes of it within some seconds."""
        team, event = self.team, self.found.events.setdefault(kind, Event())
        working = set(team.at_work())
        received, sent_bytes, begun_us = team.received.copy(), team.sent_bytes, team.now_us
        victim = min(working)
        befall(victim)
        if kind != "outcome":
            after_s = self._until(lambda: bool(set(team.at_work()) - working))
            event.replaced_s.append(GIVE_UP_US / SECOND_US if after_s is None else after_s)
        team.run_until(max(team.now_us, begun_us + WINDOW_US))
        passed_s = (team.now_us - begun_us) / SECOND_US
        usual = self.found.rest_messages * passed_s
        extra = [team.received[r] - received[r] - usual for r in team.mission.robots if r != victim]
        event.most.append(max(extra))
        event.mean.append(statistics.mean(extra))
        robots = self.found.robots
        sent_kb = (team.sent_bytes - sent_bytes) / robots - self.found.rest_bytes * passed_s
        event.kb.append(sent_kb / 1_000)
        return victim

    # -- facts, late robots, partitions -------------------------------------------------------

    def _is_one_team(self, robots: int) -> bool:
        """Whether that many robots are members for one another and have the same facts."""
        agents = self.team.living()
        alive = {frozenset(agent.alive()) for agent in agents}
        digests = {agent.facts.map.digest() for agent in agents}
        return len(digests) == len(alive) == 1 and len(min(alive)) == robots

    def _see(self) -> None:
        """Robots end their work and say what they have seen, all at the same time."""
        team, found = self.team, self.found
        working = team.at_work()[:-1] or team.at_work()
        cells = FACTS_PER_ROBOT * found.robots
        for number, robot in enumerate(working):
            seen = range(number, cells, len(working))
            team.end_action(robot, tuple((f"seen(c{cell:05})", True) for cell in seen))
        alive = len(team.living())
        found.facts_s = self._until(
            lambda: len(team.living()[0].facts.map) > cells and self._is_one_team(alive)
        )
        found.facts = len(team.living()[0].facts.map)

    def _join(self) -> None:
        """A robot that was killed starts again, and knows nothing."""
        team, found = self.team, self.found
        late = max(team.mission.robots.keys() - set(team.at_work()))
        team.kill(late)
        team.run_until(team.now_us + SETTLE_US)
        alive, sent_bytes = len(team.living()) + 1, team.sent_bytes
        team.launch(late)
        found.late_s = self._until(lambda: self._has_joined(late, alive))
        passed_s = 0.0 if found.late_s is None else found.late_s
        usual = found.rest_bytes * found.robots * passed_s
        found.late_kb = (team.sent_bytes - sent_bytes - usual) / 1_000

    def _has_joined(self, robot: str, alive: int) -> bool:
        """Whether it is in the team and has its facts and its plan."""
        living = {agent.robot: agent for agent in self.team.living()}
        agent = living.get(robot)
        if agent is None or agent.is_joining or not self._is_one_team(alive):
            return False
        return len({each.plan.digest for each in living.values() if each.plan is not None}) == 1

    def _cut(self) -> None:
        """Two halves cannot hear each other, until each has buried the other; then they can."""
        team, found = self.team, self.found
        team.run_until(team.now_us + SETTLE_US)
        living = [agent.robot for agent in team.living()]
        left, right = living[: len(living) // 2], living[len(living) // 2 :]
        links: list[Link] = [(a, b) for a in left for b in right]
        links += [(b, a) for a, b in links]
        team.network.block(links)
        halves = {frozenset(left), frozenset(right)}
        found.cut_s = self._until(
            lambda: {frozenset(agent.alive()) for agent in team.living()} == halves
        )
        team.run_until(team.now_us + SETTLE_US)
        team.network.unblock(links)
        found.healed_s = self._until(lambda: self._is_one_team(len(living)))


def measure_size(robots: int, events: int) -> Size:
    """One team's story; a shorter one of a large team, which would take hours."""
    events = events if robots <= MOST_WITH_ALL_EVENTS else 1
    return Story(robots).tell(events, is_whole=robots <= MOST_TOLD_WHOLE)
