"""I4, of simultaneous tasks: what a coalition did counts only if all its members began in time."""

from __future__ import annotations

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.features.exclusive.coalitions import Coalitions, coalitions_of
from mrbt_mesh.features.exclusive.fields import is_simultaneous, policy_of
from mrbt_mesh.features.exclusive.records import CoalitionId
from mrbt_mesh.sim.checkers.findings import RunFindings

# By how much robots' own clocks may differ in speed: `network` of a run.
MOST_DRIFT = 4 / 3


class BegunTogether:
    """When robots began in coalitions, by the true time, and which of these have succeeded."""

    def __init__(self, run: RunFindings) -> None:
        self._run = run
        # (activation, coalition) -> robot -> when it began first.
        self._begun: dict[tuple[str, str], dict[str, int]] = {}
        self._checked: set[tuple[str, str]] = set()
        self._changes: dict[str, int] = {}

    def started(self, agent: AgentView, start: StartAction) -> None:
        task = agent.facts.task_of(start.activation)
        if is_simultaneous(task) and start.party and not start.travel_to:
            begun = self._begun.setdefault((start.activation, start.party), {})
            begun.setdefault(agent.robot, self._run.world.clock.now_us)

    def check(self, agent: AgentView) -> None:
        """After a step of a robot that may have heard of successes."""
        if not self._begun or self._changes.get(agent.robot) == agent.facts.changes:
            return
        self._changes[agent.robot] = agent.facts.changes
        for activation, coalition in self._begun.keys() - self._checked:
            task, known = agent.facts.task_of(activation), coalitions_of(agent.facts, activation)
            token = CoalitionId.parse(coalition)
            if task is not None and token in known.members and _has_succeeded(task, known, token):
                self._checked.add((activation, coalition))
                self._check(task, activation, coalition, known)

    def _check(self, task: GlobalTask, activation: str, coalition: str, known: Coalitions) -> None:
        run = self._run
        members = known.members[CoalitionId.parse(coalition)]
        begun = self._begun[activation, coalition]
        counted = [
            begun[member.robot]
            for member in members
            if known.outcome(CoalitionId.parse(coalition), member) and member.robot in begun
        ]
        run.checks["I4"] += 1
        policy = policy_of(task)
        own_us = policy.begin_within_us if policy is not None else None
        within_us = own_us or run.world.timing.detection_us
        if max(counted) - min(counted) > within_us * MOST_DRIFT:
            late_s = (max(counted) - min(counted)) / 1e6
            text = f"{activation} counts, and its robots began {late_s:g} s one after the other"
            run.violation("I4", text)


def _has_succeeded(task: GlobalTask, known: Coalitions, token: CoalitionId) -> bool:
    """Whether the coalition counts: nu of its members have succeeded, and it is not broken."""
    if token in known.broken:
        return False
    done = [m.local_task for m in known.members[token] if known.outcome(token, m)]
    return all(done.count(need.local_task) >= need.min_robots for need in task.needs)
