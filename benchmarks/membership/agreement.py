"""How fast a team agrees after an event, and how much it sends meanwhile."""

from __future__ import annotations

import random

from benchmarks.membership.networks import SECOND_US, WARM_UP_US, Net, mission
from benchmarks.membership.team import SteppedTeam
from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.membership.peer import State

GIVE_UP_US = 10 * SECOND_US


class Drill:
    """Events of a team at work; each is timed until every living robot may start.

    That is: all have the same plan, and each has had it from all others.
    """

    KINDS = ("outcome", "minor fault", "outcome", "recovery", "death", "join")

    def __init__(self, robots: int, net: Net, events: int, seed: int) -> None:
        # Not work for all: planning for it would take most of the benchmark's time.
        self.team = SteppedTeam(mission(robots, 6 + events // 2), net.knobs(), seed)
        self.team.on_step = self._step
        self.times_us: dict[str, list[int]] = {}
        self._random = random.Random(f"drill/{seed}")
        self._events = events
        self._since_us: int | None = None
        self._agreed_us: int | None = 0
        self._dead = ""
        self._faulty = ""

    def run(self) -> dict[str, list[int]]:
        """Kind of event -> times."""
        self.team.launch_all()
        self.team.run_until(WARM_UP_US)
        for number in range(self._events):
            kind = self.KINDS[number % len(self.KINDS)]
            self._agreed_us = None
            self._since_us = self.team.now_us
            if not self._befall(kind):
                continue
            end_us = self.team.now_us + GIVE_UP_US
            while self._agreed_us is None and self.team.now_us < end_us:
                self.team.run_until(self.team.now_us + 100_000)
            time_us = GIVE_UP_US if self._agreed_us is None else self._agreed_us
            self.times_us.setdefault(kind, []).append(time_us)
            self.team.run_until(self.team.now_us + SECOND_US + self._random.randrange(SECOND_US))
        return self.times_us

    def _befall(self, kind: str) -> bool:
        """Let it happen; False if no plan changes."""
        chosen = self._random.choice(self.team.at_work())
        match kind:
            case "outcome":
                self.team.end_action(chosen)
            case "minor fault":
                self._faulty = chosen
                self.team.give(chosen, CapabilityChanged("explore", lost=True))
            case "recovery":
                before = self.team.agent(self._faulty).plan
                self.team.give(self._faulty, CapabilityChanged("explore", lost=False))
                after = self.team.agent(self._faulty).plan
                return before is not None and after is not None and before.digest != after.digest
            case "death":
                self._dead, self._since_us = chosen, None
                self.team.kill(self._dead)
            case _:
                self.team.launch(self._dead)
                self._dead = ""
        return True

    def _step(self, agent: AgentView, now_us: int) -> None:
        if self._agreed_us is not None:
            return
        if self._since_us is None:
            # A death counts from the first declaration: before, it is detection.
            if not self._is_found_dead(agent):
                return
            self._since_us = now_us
        if self._is_settled():
            self._agreed_us = now_us - self._since_us

    def _is_found_dead(self, agent: AgentView) -> bool:
        return agent.peers[self._dead].state is State.DEAD

    def _is_settled(self) -> bool:
        agents = self.team.living()
        plans = [agent.plan for agent in agents if not agent.is_joining]
        digests = {plan.digest for plan in plans if plan is not None}
        if len(plans) < len(agents) or len(digests) != 1:
            return False
        if self._dead and not all(map(self._is_found_dead, agents)):
            return False
        return all(agent.agrees() for agent in agents)


def agreement(robots: int, net: Net, events: int, seed: int) -> dict[str, list[int]]:
    return Drill(robots, net, events, seed).run()


def traffic(robots: int, net: Net, seed: int) -> dict[str, float]:
    """Copies sent per robot and second, and kB: at rest, and in the second after an outcome."""
    team = SteppedTeam(mission(robots, 3), net.knobs(), seed)
    team.launch_all()
    team.run_until(6 * SECOND_US)
    found = {}
    for label, window_us in (("rest", 2 * SECOND_US), ("event", SECOND_US)):
        if label == "event":
            team.end_action(team.at_work()[0])
        sent, sent_bytes = team.sent, team.sent_bytes
        team.run_until(team.now_us + window_us)
        scale = robots * window_us / SECOND_US
        found[f"{label}_messages"] = (team.sent - sent) / scale
        found[f"{label}_kb"] = (team.sent_bytes - sent_bytes) / scale / 1_000
    return found
