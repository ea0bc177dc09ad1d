"""Agents on the faulty network and nothing else: no programs, no observer, no checkers.

Far lighter than a `World`, for what only concerns who hears whom: membership and agreement over
long times and many robots. Actions never end by themselves; whoever drives the mesh ends them.
"""

from __future__ import annotations

import heapq
import random
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import (
    Ask,
    CancelAction,
    DeclareToken,
    Effect,
    Publish,
    Reply,
    StartAction,
    Stop,
)
from mrbt_mesh.core.agent.inputs import (
    ActionStopped,
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    TimerFired,
    TokenChanged,
)
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.runtime.engine_choice import chosen_engine
from mrbt_mesh.sim.engine.network import Network, NetworkKnobs

RUN = "mesh"
START_SPREAD_US = 200_000


class Node:
    """One robot's process. A frozen one keeps its mail; `action` is the ticket that runs."""

    def __init__(self, agent: Agent) -> None:
        self.agent = agent
        self.is_frozen = False
        self.stop: Stop | None = None
        self.token: Incarnation | None = None
        self.action: int | None = None
        self.mail: list[Input] = []
        self.timer_us = 0

    @property
    def runs(self) -> bool:
        return self.stop is None and not self.is_frozen


class Mesh:
    """Robots of one mission, driven by `run_until`; the same seed gives the same run.

    `on_beat(source, target, now_us)` sees every beat as it arrives, `on_step(node, now_us)` every
    robot after it has taken in something. `traffic` counts copies that were sent, and their
    bytes, by kind of message: a beat to five peers counts five times.
    """

    def __init__(
        self, mission: Mission, network: NetworkKnobs, seed: int, timing: Timing | None = None
    ) -> None:
        self.mission = mission
        self.timing = timing or Timing()
        self.network = Network(network, seed)
        self.now_us = 0
        self.nodes: dict[str, Node] = {}
        self.messages: Counter[str] = Counter()
        self.bytes: Counter[str] = Counter()
        self.on_beat: Callable[[str, str, int], None] | None = None
        self.on_step: Callable[[Node, int], None] | None = None
        self._random = random.Random(f"{seed}/mesh")
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._sequence = 0
        self._lives = 0
        self._questions: dict[int, str] = {}

    # -- what a driver may do -----------------------------------------------------------------

    def launch_all(self, robots: Iterable[str] | None = None) -> None:
        """Start the robots (all of the mission by default) within a beat period."""
        team = sorted(self.mission.robots if robots is None else robots)
        for robot in team:
            at_us = self.now_us + self._random.randrange(START_SPREAD_US)
            self._at(at_us, partial(self._launch_member, robot, team))

    def _launch_member(self, robot: str, team: list[str]) -> None:
        self.launch(robot, team)

    def launch(self, robot: str, team: Iterable[str]) -> Node:
        """Start one robot, with an empty journal; `team` is whom it expects to hear."""
        self._lives += 1
        config = AgentConfig(
            robot=robot,
            type=self.mission.robots[robot].type,
            capabilities=dict(self.mission.robots[robot].capabilities),
            run=RUN,
            nonce=f"n{self._lives}",
            solver=default_solver,
            timing=self.timing,
            expected=frozenset(team),
            engine=chosen_engine(),
        )
        node = self.nodes[robot] = Node(Agent(self.mission, config, self.now_us))
        for other, known in self.nodes.items():
            if other != robot and known.token is not None:
                self._tell_token(other, known.token, True, robot)
        self.give(node, TimerFired())
        return node

    def kill(self, robot: str) -> None:
        """SIGKILL: the system takes its token down."""
        node = self.nodes[robot]
        node.stop = Stop(-9, "killed")
        self._withdraw(node)

    def freeze(self, robot: str) -> None:
        """SIGSTOP."""
        self.nodes[robot].is_frozen = True

    def thaw(self, robot: str) -> None:
        """SIGCONT: the agent looks at the clock first, then at its mail."""
        node = self.nodes[robot]
        node.is_frozen = False
        mail, node.mail = node.mail, []
        for event in (TimerFired(), *mail):
            self.give(node, event)

    def living(self) -> list[Node]:
        """Those that run and are not frozen, sorted by robot."""
        return [node for _, node in sorted(self.nodes.items()) if node.runs]

    def run_until(self, until_us: int) -> None:
        """Let everything happen up to that time."""
        events = self._events
        while events and events[0][0] <= until_us:
            self.now_us, _, event = heapq.heappop(events)
            event()
        self.now_us = until_us

    def give(self, node: Node, event: Input) -> None:
        """One input to one robot, and what follows from it."""
        if node.stop is not None:
            return
        if node.is_frozen:
            node.mail.append(event)
            return
        for effect in node.agent.handle(event, self.now_us):
            self._carry_out(node, effect)
        if self.on_step is not None:
            self.on_step(node, self.now_us)
        if node.stop is None:
            due_us = node.agent.next_deadline_us(self.now_us)
            if not self.now_us < node.timer_us <= due_us:
                node.timer_us = due_us
                self._at(due_us, lambda: self._timer(node, due_us))

    # -- inside -------------------------------------------------------------------------------

    def _at(self, at_us: int, event: Callable[[], None]) -> None:
        self._sequence += 1
        heapq.heappush(self._events, (at_us, self._sequence, event))

    def _timer(self, node: Node, due_us: int) -> None:
        if node.timer_us == due_us and node.runs:
            node.timer_us = 0
            self.give(node, TimerFired())

    def _carry_out(self, node: Node, effect: Effect) -> None:
        robot = node.agent.view.robot
        match effect:
            case Publish(kind, data):
                event = MessageReceived(kind, robot, data)
                for target in self._others(robot):
                    self._send(robot, target, str(kind), len(data), event)
            case Ask(peer, data):
                self._ask(robot, peer, data)
            case Reply(query, pages):
                for page in pages:
                    asker = self._questions[query]
                    self._send(robot, asker, "state", len(page), AnswerReceived(robot, page))
            case DeclareToken(incarnation):
                self._withdraw(node)
                node.token = incarnation
                for target in self._others(robot):
                    self._tell_token(robot, incarnation, True, target)
            case StartAction():
                node.action = effect.ticket
            case CancelAction(ticket):
                node.action = None
                self._at(self.now_us, lambda: self.give(node, ActionStopped(ticket)))
            case Stop():
                node.stop = effect
                self._withdraw(node)

    def _others(self, robot: str) -> list[str]:
        return [other for other in self.nodes if other != robot]

    def _send(self, source: str, target: str, kind: str, size: int, event: Input) -> None:
        self.messages[kind] += 1
        self.bytes[kind] += size
        for arrival_us in self.network.arrivals_us(source, target, self.now_us):
            self._at(arrival_us, lambda: self._arrive(source, target, kind, event))

    def _arrive(self, source: str, target: str, kind: str, event: Input) -> None:
        node = self.nodes[target]
        if kind == MessageKind.HEARTBEAT and self.on_beat is not None and node.runs:
            self.on_beat(source, target, self.now_us)
        self.give(node, event)

    def _ask(self, robot: str, peer: str, data: bytes) -> None:
        number = len(self._questions) + 1
        self._questions[number] = robot
        if peer in self.nodes:
            query = QueryReceived(number, MessageKind.PULL, data)
            self._send(robot, peer, "pull", len(data), query)

    def _withdraw(self, node: Node) -> None:
        if node.token is not None and self.network.knobs.token_delay_us is not None:
            for target in self._others(node.agent.view.robot):
                self._tell_token(node.agent.view.robot, node.token, False, target)
        node.token = None

    def _tell_token(self, robot: str, incarnation: Incarnation, held: bool, target: str) -> None:
        at_us = self.now_us + (self.network.knobs.token_delay_us or 0)
        if (robot, target) not in self.network.blocked:
            event = TokenChanged(robot, incarnation, held)
            self._at(at_us, lambda: self.give(self.nodes[target], event))
