"""The parts of an agent, for tests that break one on purpose or look closer than users may."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from typing import Any
from unittest import mock

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.heartbeats import Heartbeats
from mrbt_mesh.core.agent.jobs_on_disk import AwaitedJob
from mrbt_mesh.core.agent.planner import Planner
from mrbt_mesh.core.facts.records import CommandKind
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


def command(agent: Agent, kind: CommandKind, now_us: int) -> None:
    """The robot writes the operator's word down."""
    agent._reports.command(kind, now_us)


def carry_out(agent: Agent, body: Any, now_us: int) -> tuple[bool, str]:
    """An operator's command."""
    answer = agent._commands.carry_out(body, now_us)
    assert not isinstance(answer, AwaitedJob)
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
