"""The parts of an agent, for tests that break one on purpose or look closer than users may."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any
from unittest import mock

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.commands import Answer
from mrbt_mesh.core.agent.commands_on_disk import AwaitedAnswer
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.heartbeats import Heartbeats
from mrbt_mesh.core.agent.operator_messages import (
    OPERATE,
    CommandStep,
    command_version,
    operate_body,
)
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.facts.records import TeamOrder
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.membership.timing import HeartbeatSchedule


def context(agent: Agent) -> Context:
    """Its facts, its view of the team, its work."""
    return agent._context


def planner(agent: Agent) -> Planner:
    return agent._planner


def schedule(agent: Agent) -> HeartbeatSchedule:
    """When it beats."""
    return agent._schedule


def pretend_to_work(agent: Agent, activation: str, *tasks: str, coalition: str = "") -> None:
    """The robot takes itself to be at work on this global task and local task."""
    global_task, local_task = tasks
    life = agent.view.incarnation
    start = StartAction(7, activation, global_task, local_task, (), 1, life, coalition)
    context(agent).work.action = start


def command(agent: Agent, kind: TeamOrder, now_us: int) -> None:
    """An operator commands the robot."""
    view = agent.view
    name, value = ("aborted", True) if kind is TeamOrder.ABORT else ("paused", str(kind))
    version = command_version(view.facts.max_stamp + 1, "c")
    entry = make_command(name, value, "op", version, view.header.run, None)
    agent._commands.carry_out([OPERATE, operate_body(CommandStep.WRITE, entry)], now_us)


def carry_out(agent: Agent, body: Any, now_us: int) -> Answer:
    """An operator's word."""
    answer = agent._commands.carry_out(body, now_us)
    assert not isinstance(answer, AwaitedAnswer)
    return answer


@contextlib.contextmanager
def counted() -> Iterator[Counter[str]]:
    """Counts how often agents `followed up` what may follow from an input, and their `beats`."""
    counts: Counter[str] = Counter()

    def counting(name: str, original: Any) -> Any:
        def call(*arguments: Any) -> Any:
            counts[name] += 1
            return original(*arguments)

        return call

    with (
        mock.patch.object(Agent, "_reconcile", counting("followed up", Agent._reconcile)),
        mock.patch.object(Heartbeats, "_send", counting("beats", Heartbeats._send)),
    ):
        yield counts
