"""What robots send one another: messages, questions with their answers, liveliness tokens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from mrbt_mesh.core.agent.effects import Ask, AskRouter, Publish, Reply
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    MessageReceived,
    QueryReceived,
    RouterAnswered,
    TokenChanged,
)
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.sim.world.clock import VirtualClock
from mrbt_mesh.sim.world.network import RETRY_US, Network, Routers

# A robot's token has appeared (true) or disappeared.
OnToken = Callable[[str, Incarnation, bool], None]


class Endpoint(Protocol):
    """A robot's process, as far as the bus has to do with it."""

    robot: str

    @property
    def is_over(self) -> bool: ...
    def deliver(self, event: Input) -> None: ...


@dataclass(slots=True)
class _Question:
    """A query on its way, its sender and receiver; it is answered once."""

    asker: Endpoint
    peer: str
    answered: bool = False


class MessageBus:
    """Carries what processes send over a faulty network; the simulator's Zenoh.

    `endpoints`: robot -> its latest process. `tokens`: those that are held. `on_token` is called
    at every change of them, as the robots are notified.
    """

    def __init__(
        self, clock: VirtualClock, network: Network, routers: Routers, on_token: OnToken
    ) -> None:
        self.clock = clock
        self.network = network
        self.routers = routers
        self.endpoints: dict[str, Endpoint] = {}
        self.tokens: dict[str, Incarnation] = {}
        self._on_token = on_token
        self._questions: dict[int, _Question] = {}
        # By the number of a query from outside of the team, which is below 0.
        self._answers: dict[int, list[bytes]] = {}

    def deliver(self, target: str, event: Input) -> None:
        """Hand an input to a robot's process."""
        process = self.endpoints.get(target)
        if process is not None:  # else it has not been started yet
            process.deliver(event)

    def _arrive(self, target: str, event: Input) -> None:
        """The same for what comes over the network."""
        if self.routers.reaches(target):
            self.deliver(target, event)

    # -- messages and questions ---------------------------------------------------------------

    def publish(self, source: str, effect: Publish) -> MessageReceived:
        """Send to all others, or to some; returns what arrives there."""
        event = MessageReceived(effect.kind, source, effect.data)
        if not self.routers.reaches(source):
            return event
        if effect.to is not None:
            for target in effect.to:
                if target in self.endpoints:
                    self._send(source, target, event)
            return event
        arrivals = self.network.arrivals_at_all(source, self.endpoints, self.clock.now_us)
        for arrival_us, targets in arrivals.items():
            self.clock.at(arrival_us, partial(self._deliver_to_all, targets, event))
        return event

    def _deliver_to_all(self, targets: list[str], event: Input) -> None:
        for target in targets:
            self._arrive(target, event)

    def _send(self, source: str, target: str, event: Input) -> None:
        if self.routers.reaches(source):
            for arrival_us in self.network.arrivals_us(source, target, self.clock.now_us):
                self.clock.at(arrival_us, partial(self._arrive, target, event))

    def ask(self, asker: Endpoint, effect: Ask) -> None:
        """Send a question to one robot; without an answer it times out."""
        number = len(self._questions) + 1
        question = self._questions[number] = _Question(asker, effect.peer)
        if effect.peer in self.endpoints:
            query = QueryReceived(number, MessageKind.PULL, effect.data)
            self._send(asker.robot, effect.peer, query)
        timeout_us = self.clock.now_us + self.network.knobs.query_timeout_us
        self.clock.at(timeout_us, lambda: self._answer(question, None))

    def reply(self, source: str, effect: Reply) -> None:
        """Answer a question of a robot."""
        question = self._questions.get(effect.query)
        if question is None:  # an operator's command, or garbage
            self._answers.get(effect.query, []).extend(effect.pages)
            return
        target = question.asker.robot
        if not self.routers.reaches(source):
            return
        for page in effect.pages:
            # A query's replies are not duplicated: Zenoh drops duplicates.
            for arrival_us in self.network.arrivals_us(source, target, self.clock.now_us)[:1]:
                self.clock.at(arrival_us, partial(self._answer, question, page))

    def await_answer(self, answers: list[bytes]) -> int:
        """The number of a query from outside of the team, whose answers are put into the list."""
        number = -len(self._answers) - 1
        self._answers[number] = answers
        return number

    def _answer(self, question: _Question, page: bytes | None) -> None:
        if page is None and question.answered:
            return
        if page is not None and not self.routers.reaches(question.asker.robot):
            return
        question.answered = True
        question.asker.deliver(AnswerReceived(question.peer, page))

    # -- tokens -------------------------------------------------------------------------------

    def declare(self, robot: str, incarnation: Incarnation) -> None:
        """Show a robot's token, in place of an earlier one."""
        self._take_down(robot)
        self.tokens[robot] = incarnation
        self._tell_everybody(robot, incarnation, True)

    def withdraw(self, robot: str) -> None:
        """A process has ended: it loses its token, if it held one, and its link to a router."""
        self._take_down(robot)
        self.routers.unlink(robot)

    def _take_down(self, robot: str) -> None:
        incarnation = self.tokens.pop(robot, None)
        if incarnation is not None:
            self._tell_everybody(robot, incarnation, False)

    def tell_tokens(self, newcomer: str) -> None:
        """Show a robot that has just started the tokens of all others."""
        if not self.routers.link(newcomer) and self.routers.names:
            self.clock.at(self.clock.now_us + RETRY_US, partial(self._link_again, newcomer))
            return
        for robot in self.endpoints:
            if robot != newcomer and robot in self.tokens:
                self._tell(robot, self.tokens[robot], True, newcomer)

    def _tell_everybody(self, robot: str, incarnation: Incarnation, held: bool) -> None:
        delay_us = self.network.knobs.token_delay_us
        if delay_us is None and not held:
            return
        targets = self.endpoints if self.routers.reaches(robot) else ()
        for target in targets:
            if target != robot and (robot, target) not in self.network.blocked:
                self._tell(robot, incarnation, held, target)
        at_us = self.clock.now_us + (delay_us or 0)
        self.clock.at(at_us, partial(self._on_token, robot, incarnation, held))

    def _tell(self, robot: str, incarnation: Incarnation, held: bool, target: str) -> None:
        at_us = self.clock.now_us + (self.network.knobs.token_delay_us or 0)
        event = TokenChanged(robot, incarnation, held, self.routers.of.get(robot, ""))
        self.clock.at(at_us, partial(self._arrive, target, event))

    # -- routers ------------------------------------------------------------------------------

    def end_router(self, router: str) -> None:
        """A router dies: tokens are gone on both sides, until its clients have found another."""
        named = {robot: self.routers.of.get(robot, "") for robot in self.tokens}
        clients = self.routers.end(router)
        for robot, incarnation in self.tokens.items():
            event = TokenChanged(robot, incarnation, False, named[robot])
            for target in self.endpoints:
                if target != robot and (robot in clients or target in clients):
                    self.deliver(target, event)
        for robot, without_us in clients.items():
            self.clock.at(self.clock.now_us + without_us, partial(self._link_again, robot))

    def _link_again(self, robot: str) -> None:
        process = self.endpoints[robot]
        if process.is_over or self.routers.reaches(robot):
            return  # ended, or it is another process by now
        if not self.routers.link(robot):
            self.clock.at(self.clock.now_us + RETRY_US, partial(self._link_again, robot))
            return
        if robot in self.tokens:
            self._tell_everybody(robot, self.tokens[robot], True)
        for other in self.endpoints:
            if other != robot and other in self.tokens and self.routers.reaches(other):
                self._tell(other, self.tokens[other], True, robot)

    def ask_router(self, asker: Endpoint, effect: AskRouter) -> None:
        """Ask a router for its link to a robot; a dead one gives no answer."""
        found: list[bool | None] = []
        there_us = self.clock.now_us + self.network.knobs.link.delay_us

        def ask() -> None:
            found.append(self.routers.is_linked(effect.robot, effect.router))

        def answer() -> None:
            is_linked = found[0] if self.routers.reaches(asker.robot) else None
            asker.deliver(RouterAnswered(effect.robot, effect.incarnation, is_linked))

        self.clock.at(there_us, ask)
        self.clock.at(there_us + self.network.knobs.link.delay_us, answer)
