"""A simulated robot that lies, with its own valid key, in whatever it may write.

It runs the same program as all, and works as they do. From a stated time on it writes facts, or
changes its heartbeats, as a lie says. Checkers look at the honest robots alone.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any
from unittest import mock

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Record
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim.checkers import checkers, findings
from mrbt_mesh.sim.checkers.checkers import Checkers
from mrbt_mesh.sim.checkers.facts import NothingUndone
from mrbt_mesh.sim.world.process import SimProcess
from mrbt_mesh.sim.world.world import World
from tests.support import inside


@dataclass
class Liar:
    """What a lie is made of: the robot's own parts, and the time."""

    agent: Agent
    now_us: int

    @property
    def context(self) -> Context:
        return inside.context(self.agent)

    @property
    def plan(self) -> Plan:
        plan = inside.planner(self.agent).plan
        assert plan is not None
        return plan

    @property
    def facts(self) -> TeamFacts:
        return self.context.facts

    def write(self, *facts: tuple[str, Record]) -> None:
        """Write these facts under its own name, whatever its own facts are."""
        self.context.write(list[Fact](facts), self.now_us)


Lie = Callable[[Liar], Any]


@contextlib.contextmanager
def lying(robot: str, lie: Lie, after_us: int, every_us: int = 0) -> Iterator[None]:
    """In runs inside of this, `robot` tells the lie at a time, and again if `every_us` is not 0."""
    next_us = {"": after_us}
    handle = Agent.handle

    def handling(agent: Agent, event: Input, now_us: int) -> list[Effect]:
        context = inside.context(agent)
        effects = handle(agent, event, now_us)
        at_us = next_us[""]
        is_time = context.me == robot and context.joining is None and 0 <= at_us <= now_us
        if is_time and not context.has_stopped:
            next_us[""] = now_us + every_us if every_us else -1
            lie(Liar(agent, now_us))
            effects += context.take_effects()
        return effects

    with mock.patch.object(Agent, "handle", handling), honest_are_checked(robot):
        yield


@contextlib.contextmanager
def honest_are_checked(liar: str) -> Iterator[None]:
    """Checkers do not see what this robot does, knows or plans."""
    patches = [
        mock.patch.object(kind, name, _skipping(getattr(kind, name), liar))
        for kind, name in (
            (Checkers, "booted"),
            (Checkers, "synced"),
            (Checkers, "handling"),
            (Checkers, "handled"),
            (NothingUndone, "check"),
        )
    ]

    def honest(world: World) -> list[AgentView]:
        return [agent for agent in findings.joined(world) if agent.robot != liar]

    patches += [
        mock.patch.object(checkers, "joined", honest),
        # The liar is alive, but not among those that are checked.
        mock.patch.object(checkers, "same_members", return_value=True),
    ]
    with contextlib.ExitStack() as stack:
        for each in patches:
            stack.enter_context(each)
        yield


def _skipping(call: Any, liar: str) -> Any:
    def checked(checker: Any, process: SimProcess, *rest: Any) -> None:
        if process.robot != liar:
            call(checker, process, *rest)

    return checked
