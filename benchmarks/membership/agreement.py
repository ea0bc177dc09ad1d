"""How fast a team agrees after an event, and what it sends meanwhile."""

from __future__ import annotations

import random

from benchmarks.membership.mesh import Mesh, Node
from benchmarks.membership.networks import SECOND_US, WARM_UP_US, Net, mission
from mrbt_mesh.core.agent.inputs import ActionFinished, CapabilityChanged
from mrbt_mesh.core.membership.membership import State

GIVE_UP_US = 10 * SECOND_US


class Drill:
    """Events befall a team at work; each is timed until every living robot may start.

    That is: all have the same plan, and each has heard it of all others.
    """

    KINDS = ("outcome", "minor fault", "outcome", "recovery", "death", "join")

    def __init__(self, robots: int, net: Net, events: int, seed: int) -> None:
        # Not work for all: planning for it would take most of the benchmark's time.
        self.mesh = Mesh(mission(robots, 6 + events // 2), net.knobs(), seed)
        self.mesh.on_step = self._step
        self.times_us: dict[str, list[int]] = {}
        self._random = random.Random(f"drill/{seed}")
        self._events = events
        self._since_us: int | None = None
        self._agreed = True
        self._agreed_us = 0
        self._dead = ""
        self._faulty: Node | None = None

    def run(self) -> dict[str, list[int]]:
        """Kind of event -> times."""
        self.mesh.launch_all()
        self.mesh.run_until(WARM_UP_US)
        for number in range(self._events):
            kind = self.KINDS[number % len(self.KINDS)]
            self._agreed = False
            self._since_us = self.mesh.now_us
            if not self._befall(kind):
                continue
            end_us = self.mesh.now_us + GIVE_UP_US
            while not self._agreed and self.mesh.now_us < end_us:
                self.mesh.run_until(self.mesh.now_us + 100_000)
            time_us = self._agreed_us if self._agreed else GIVE_UP_US
            self.times_us.setdefault(kind, []).append(time_us)
            self.mesh.run_until(self.mesh.now_us + SECOND_US + self._random.randrange(SECOND_US))
        return self.times_us

    def _befall(self, kind: str) -> bool:
        """Let it happen; False if it changes nothing, since nobody has to do anything else."""
        working = [node for node in self.mesh.living() if node.agent.view.action is not None]
        chosen = self._random.choice(working)
        match kind:
            case "outcome":
                assert chosen.agent.view.action is not None
                ticket = chosen.agent.view.action.number
                self.mesh.give(chosen, ActionFinished(ticket, True))
            case "minor fault":
                self._faulty = chosen
                self.mesh.give(chosen, CapabilityChanged("explore", lost=True))
            case "recovery":
                assert self._faulty is not None
                before = self._faulty.agent.view.plan
                self.mesh.give(self._faulty, CapabilityChanged("explore", lost=False))
                after = self._faulty.agent.view.plan
                return before is not None and after is not None and before.digest != after.digest
            case "death":
                self._dead, self._since_us = chosen.agent.view.robot, None
                self.mesh.kill(self._dead)
            case _:
                self.mesh.launch(self._dead, sorted(self.mesh.mission.robots))
                self._dead = ""
        return True

    def _step(self, node: Node, now_us: int) -> None:
        if self._agreed:
            return
        if self._since_us is None:
            # A death counts from the first verdict: before, it is detection.
            if not self._is_buried(node):
                return
            self._since_us = now_us
        if self._is_settled():
            self._agreed = True
            self._agreed_us = now_us - self._since_us

    def _is_buried(self, node: Node) -> bool:
        return node.agent.view.peers[self._dead].state is State.DEAD

    def _is_settled(self) -> bool:
        nodes = self.mesh.living()
        plans = [node.agent.view.plan for node in nodes if not node.agent.view.is_joining]
        digests = {plan.digest for plan in plans if plan is not None}
        if len(plans) < len(nodes) or len(digests) != 1:
            return False
        if self._dead and not all(map(self._is_buried, nodes)):
            return False
        return all(node.agent.view.agrees() for node in nodes)


def agreement(robots: int, net: Net, events: int, seed: int) -> dict[str, list[int]]:
    return Drill(robots, net, events, seed).run()


def traffic(robots: int, net: Net, seed: int) -> dict[str, float]:
    """Copies sent per robot and second, and kB: at rest, and in the second after an outcome."""
    mesh = Mesh(mission(robots, 3), net.knobs(), seed)
    mesh.launch_all()
    mesh.run_until(6 * SECOND_US)
    found = {}
    for label, window_us in (("rest", 2 * SECOND_US), ("event", SECOND_US)):
        if label == "event":
            node = next(n for n in mesh.living() if n.agent.view.action is not None)
            assert node.agent.view.action is not None
            mesh.give(node, ActionFinished(node.agent.view.action.number, True))
        before = (sum(mesh.messages.values()), sum(mesh.bytes.values()))
        mesh.run_until(mesh.now_us + window_us)
        scale = robots * window_us / SECOND_US
        found[f"{label}_messages"] = (sum(mesh.messages.values()) - before[0]) / scale
        found[f"{label}_kb"] = (sum(mesh.bytes.values()) - before[1]) / scale / 1_000
    return found
