"""Decides when a step of a drill is due, from what the drill's observer sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.drills.model import (
    DONE,
    BlockedTrigger,
    ConditionTrigger,
    GlobalTaskTrigger,
    LocalTaskTrigger,
    Robots,
    RobotTrigger,
    RoleModel,
    StepModel,
    TakeoverTrigger,
)
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.task_log import TaskState
from mrbt_mesh.runtime.fencing import boottime_us


@dataclass(frozen=True, slots=True)
class Takeover:
    """A robot has started what a dead one was running."""

    robot: str
    local_task: str
    replacement: str
    at_us: int


@dataclass(frozen=True)
class Snapshot:
    """What the observer sees at one moment. `claims` are those of living robots.

    `claimed` has all claims ever seen, with their times, since some stand only for a moment. `done`
    are (robot, local task) with an outcome, successful or not. `blocked`: global task -> reason.
    """

    now_us: int
    started_us: int | None = None
    statuses: Mapping[str, TaskState] = field(default_factory=dict)
    claims: Mapping[str, Claim] = field(default_factory=dict)
    claimed: Sequence[tuple[int, str, Claim]] = ()
    done: frozenset[tuple[str, str]] = frozenset()
    states: Mapping[str, State] = field(default_factory=dict)
    conditions: Mapping[str, bool] = field(default_factory=dict)
    takeovers: tuple[Takeover, ...] = ()
    blocked: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, observer: Observer, conditions: Sequence[str], now_us: int) -> Snapshot:
        """Return what an observer sees now; of the conditions, only those given."""
        record, facts = observer.record, observer.facts
        claims = {robot: observer.claim(robot) for robot in observer.robots()}
        return cls(
            now_us,
            record.started_us,
            {name: task.state for name, task in record.task_log.tasks.items()},
            {robot: claim for robot, claim in claims.items() if claim is not None},
            record.claims,
            frozenset(
                (robot, local_task)
                for said in facts.activations.values()
                for local_task, robots in said.outcomes.items()
                for robot in robots
            ),
            {robot: observer.robot_state(robot) for robot in observer.robots()},
            {name: facts.condition(name) for name in conditions},
            tuple(
                Takeover(f.robot, f.held.local_task, f.replacement, f.reassigned_us)
                for f in record.major
                if f.held and f.replacement and f.reassigned_us is not None
            ),
            {e.request: e.reason for e in record.blocked if e.to_us is None},
        )


class FaultLog:
    """The current roles of robots by what was done to them: killed, stopped, thawed, left."""

    def __init__(self) -> None:
        self.killed: list[str] = []
        self.stopped: list[str] = []
        self.thawed: list[str] = []
        self.left: list[str] = []

    def lives(self, robot: str) -> None:
        """Remove a robot's roles, because a new process of it has been started."""
        for listed in (self.killed, self.stopped, self.thawed, self.left):
            if robot in listed:
                listed.remove(robot)


def chosen(robots: Robots, snapshot: Snapshot, fault_log: FaultLog) -> list[str]:
    """Return the robots that a step means at the moment of the snapshot; possibly none."""
    if isinstance(robots, str):
        return [robots]
    if not isinstance(robots, RoleModel):
        return list(robots)
    match robots.role:
        case "performing":
            return _performing(robots.performing, snapshot)
        case "replacement":
            latest = max(snapshot.takeovers, key=lambda t: t.at_us, default=None)
            return [] if latest is None else [latest.replacement]
        case role:
            listed: list[str] = getattr(fault_log, role)
            return list(listed)


def _performing(task: str | None, snapshot: Snapshot) -> list[str]:
    """Return the robots that run it, or else have claimed it.

    Claims may conflict until all agree.
    """
    found = [
        (robot, claim.phase is Phase.RUNNING)
        for robot, claim in sorted(snapshot.claims.items())
        if task in (claim.global_task, claim.local_task, type_name(claim.local_task))
    ]
    running = [robot for robot, runs in found if runs]
    return running or [robot for robot, _ in found]


def holds(when: Any, snapshot: Snapshot, fault_log: FaultLog, since_us: int) -> bool:
    """Return whether a trigger's condition holds; `since_us` is when the step before began."""
    match when:
        case GlobalTaskTrigger(global_task=task, status=status):
            return snapshot.statuses.get(task, TaskState.IDLE) is TaskState(status)
        case LocalTaskTrigger():
            return _local_task(when, snapshot, since_us)
        case RobotTrigger(robot=robots, state=state):
            found = chosen(robots, snapshot, fault_log)
            return bool(found) and all(snapshot.states.get(r) == State(state) for r in found)
        case ConditionTrigger(condition=name, value=value):
            return bool(snapshot.conditions[name] == value)
        case TakeoverTrigger(takeover=task):
            return any(t.at_us >= since_us and _is(t.local_task, task) for t in snapshot.takeovers)
        case BlockedTrigger(blocked=task, reason=reason):
            return reason in snapshot.blocked.get(task, "") and task in snapshot.blocked
    raise TypeError(f"no trigger: {when!r}")


def _local_task(when: LocalTaskTrigger, snapshot: Snapshot, since_us: int) -> bool:
    if when.phase == DONE:
        return any(
            _is(done, when.local_task) and when.robot in (None, robot)
            for robot, done in snapshot.done
        )
    since = ((robot, claim) for at_us, robot, claim in snapshot.claimed if at_us >= since_us)
    return any(
        _is(claim.local_task, when.local_task)
        and when.robot in (None, robot)
        and claim.phase.name.lower() == when.phase
        for robot, claim in (*snapshot.claims.items(), *since)
    )


def _is(ground: str, task: str) -> bool:
    """Return whether a ground local task is `task`, or of that type."""
    return task in (ground, type_name(ground))


class Schedule:
    """The steps of a drill, one after the other."""

    def __init__(self, steps: Sequence[StepModel]) -> None:
        self.steps = steps
        self.next = 0
        self._conditions = [
            step.when.condition for step in steps if isinstance(step.when, ConditionTrigger)
        ]
        self._previous_us: int | None = None
        self._triggered_us: int | None = None

    @property
    def is_over(self) -> bool:
        """True once all steps have been carried out."""
        return self.next == len(self.steps)

    def held(self) -> frozenset[str]:
        """Return the tasks that must be running when the next step is due, and so must not end
        before it.
        """
        return frozenset() if self.is_over else _met_running(self.steps[self.next])

    def look(self, observer: Observer) -> Snapshot:
        """Return what an observer sees now, as far as triggers need it."""
        return Snapshot.of(observer, self._conditions, boottime_us())

    def due(self, snapshot: Snapshot, fault_log: FaultLog) -> StepModel | None:
        """Return the next step if it is due. Call `carried_out` before asking again."""
        if self.is_over or snapshot.started_us is None:
            return None
        step = self.steps[self.next]
        due_us = self.due_us(snapshot, fault_log)
        if due_us is None or snapshot.now_us < due_us:
            return None
        # A role may have no robot yet: a request precedes its claims.
        is_played = all(chosen(robots, snapshot, fault_log) for robots in step.robots())
        return step if is_played else None

    def due_us(self, snapshot: Snapshot, fault_log: FaultLog) -> int | None:
        """Return when the next step is due, or None if that is not known yet."""
        if self.is_over or snapshot.started_us is None:
            return None
        step = self.steps[self.next]
        previous_us = self._previous_us if self._previous_us is not None else snapshot.started_us
        after_us = round((step.after or 0) * 1e6)
        if step.at is not None:
            return snapshot.started_us + round(step.at * 1e6)
        if step.when is None:
            return previous_us + after_us
        if self._triggered_us is None and holds(step.when, snapshot, fault_log, previous_us):
            self._triggered_us = snapshot.now_us
        return None if self._triggered_us is None else self._triggered_us + after_us

    def carried_out(self, begun_us: int) -> None:
        """Advance after the due step has been carried out, starting at `begun_us`."""
        self.next += 1
        self._previous_us, self._triggered_us = begun_us, None


def _met_running(step: StepModel) -> frozenset[str]:
    """Return the task whose running a step waits for, or assumes if it has no trigger.

    With another trigger, a task that is `performing` may have to end before the trigger holds.
    """
    match step.when:
        case LocalTaskTrigger(local_task=task, phase=phase) if phase != DONE:
            return frozenset({task})
        case GlobalTaskTrigger(global_task=task, status="running"):
            return frozenset({task})
        case TakeoverTrigger(takeover=task):
            return frozenset({task})
        case None:
            roles = [robots for robots in step.robots() if isinstance(robots, RoleModel)]
            return frozenset(role.performing for role in roles if role.performing is not None)
        case _:
            return frozenset()
