"""I5: an exclusive task has one coalition at a time, and is not begun again once it was. I4, of
simultaneous tasks: what a coalition did counts only if all its members began in time.

A robot works from the start of its action until that has ended, or its process has; a frozen one
does not work. Grants and claims count once robots have them on disk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.agent.effects import Effect, StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished, ActionStopped, Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.mission.mission import GlobalTask
from mrbt_mesh.features.exclusive.coalitions import Coalitions, coalitions_of
from mrbt_mesh.features.exclusive.fields import (
    InDoubtPolicy,
    in_doubt_policy,
    is_simultaneous,
    policy_of,
)
from mrbt_mesh.features.exclusive.kinds import GRANT
from mrbt_mesh.features.exclusive.records import CoalitionId
from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker
from mrbt_mesh.sim.checkers.findings import RunFindings
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import SimProcess


@dataclass
class _Coalition:
    """The robots that began, their tickets, and how they ended (None: without an outcome)."""

    tasks: dict[SimProcess, str] = field(default_factory=dict)
    tickets: dict[SimProcess, int] = field(default_factory=dict)
    ends: dict[SimProcess, bool | None] = field(default_factory=dict)

    def at_work(self) -> list[str]:
        return [
            process.robot
            for process in self.tickets
            if process.runs and not process.is_slow and process not in self.ends
        ]

    def has_succeeded(self, task: GlobalTask) -> bool:
        done = [self.tasks[process] for process, success in self.ends.items() if success]
        return all(done.count(need.local_task) >= need.min_robots for need in task.needs)

    def is_resolved(self) -> bool:
        """Whether all that began have ended with an outcome."""
        return all(self.ends.get(process) is not None for process in self.tasks)


class BegunOnce(FeatureChecker):
    """I5, over all exclusive activations of a run.

    `done_twice` counts the coalitions that succeeded after another one: there must be none.
    """

    def __init__(self, run: RunFindings) -> None:
        super().__init__(run)
        self._has_tasks = run.world.mission.has_tasks_at_most_once
        # Activation -> its task, of those that have begun.
        self._tasks: dict[str, GlobalTask] = {}
        self._coalitions: dict[tuple[str, str], dict[str, _Coalition]] = {}
        self._givers: dict[tuple[str, str], set[str]] = {}
        # Robot -> the activation that it has claimed, by its disk.
        self._claimed: dict[str, str] = {}

    def handling(self, process: SimProcess, agent: AgentView, event: Input) -> None:
        action = agent.action
        if not isinstance(event, ActionFinished | ActionStopped):
            return
        if action is None or action.travel_to:
            return
        if action.activation in self._tasks and action.ticket == event.ticket:
            success = event.success if isinstance(event, ActionFinished) else None
            known = self._coalitions[action.global_task, action.activation]
            known[action.party].ends[process] = success

    def handled(self, process: SimProcess, effects: Sequence[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, StartAction) and not effect.travel_to:
                self._start(process, effect)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        for entry in changes.values():
            if entry is not None and entry.author == process.robot:
                kind, *scope = entry.parts
                if kind == GRANT:
                    activation, token = scope
                    self._givers.setdefault((activation, token), set()).add(process.robot)
                elif isinstance(entry.record, Claim):
                    self._claimed[process.robot] = entry.record.activation

    def _start(self, process: SimProcess, start: StartAction) -> None:
        assert process.agent is not None
        run, tasks = self.run, self.run.world.mission.global_tasks
        task = tasks.get(start.global_task) or process.agent.view.facts.task(start.activation)
        if not task.at_most_once:
            return
        self._tasks[start.activation] = task
        run.checks["I5"] += 1
        known = self._coalitions.setdefault((start.global_task, start.activation), {})
        givers = self._givers.get((start.activation, start.party), set())
        if 2 * len(givers) <= len(run.world.mission.robots):
            granted = ", ".join(sorted(givers)) or "nobody"
            text = f"{process.robot} begins {start.activation}, which only {granted} granted"
            run.violation("I5", text)
        if self._claimed.get(process.robot) != start.activation:
            text = f"{process.robot} begins {start.activation}, and its claim is not on disk"
            run.violation("I5", text)
        for token, other in known.items():
            if token == start.party:
                continue
            begins = f"{process.robot} begins {start.activation} ({start.party})"
            if others := other.at_work():
                text = f"{begins} while {', '.join(others)} are at it ({token})"
            elif other.has_succeeded(task):
                text = f"{begins}, which was finished ({token})"
            elif not other.is_resolved() and in_doubt_policy(task) is not InDoubtPolicy.RETRY:
                text = f"{begins}, which was left in doubt ({token})"
            else:
                continue
            run.violation("I5", text)
        mine = known.setdefault(start.party, _Coalition())
        mine.tasks[process] = start.local_task
        mine.tickets[process] = start.ticket

    @property
    def wait_us(self) -> int:
        """How long robots may wait, and write nothing, for grants to expire."""
        return self.run.world.timing.promise_us if self._has_tasks else 0

    @property
    def done_twice(self) -> int:
        return sum(
            max(0, sum(c.has_succeeded(self._tasks[name]) for c in known.values()) - 1)
            for (_, name), known in self._coalitions.items()
        )


# By how much robots' own clocks may differ in speed: `network` of a run.
MOST_DRIFT = 4 / 3


class BegunTogether(FeatureChecker):
    """When robots began in coalitions, by the true time, and which of these have succeeded."""

    def __init__(self, run: RunFindings) -> None:
        super().__init__(run)
        # (activation, coalition) -> robot -> when it began first.
        self._begun: dict[tuple[str, str], dict[str, int]] = {}
        self._checked: set[tuple[str, str]] = set()
        self._changes: dict[str, int] = {}

    def started(self, agent: AgentView, start: StartAction) -> None:
        task = agent.facts.task_of(start.activation)
        if is_simultaneous(task) and start.party:
            begun = self._begun.setdefault((start.activation, start.party), {})
            begun.setdefault(agent.robot, self.run.world.clock.now_us)

    def stepped(self, agent: AgentView) -> None:
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
        run = self.run
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
