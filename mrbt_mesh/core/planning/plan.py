"""The plan: what each robot does and why, for the whole team.

Same facts and same alive set give the same bytes on every robot (`planning`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import msgpack

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import ConditionValue, TeamOrder
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.feature import PlanPart, features
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.mission import MICRO, Mission, MissionEnd
from mrbt_mesh.core.planning.demands import Group
from mrbt_mesh.core.planning.schedules import Lookahead

# How many robots are listed by name.
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Shortage:
    """A local task that lacks robots: nu, living capable robots, outcomes so far.

    `after`: what they have to have done before.
    """

    local_task: str
    needed: int
    alive: int
    done: int
    failed: int
    after: str = ""

    def __str__(self) -> str:
        text = f"{self.local_task} needs {self.needed}{self.after}, {self.alive} alive"
        counts = ((self.done, "done"), (self.failed, "failed"))
        return text + "".join(f", {count} {what}" for count, what in counts if count)


def shortened(robots: Sequence[str]) -> str:
    """For people: all of a few robots, else some of them and how many more."""
    if len(robots) <= _SHOWN + 1:
        return ", ".join(robots)
    return f"{', '.join(robots[:_SHOWN])} and {len(robots) - _SHOWN} more"


@dataclass(frozen=True, slots=True)
class RobotAssignment:
    """What the plan has one robot do. `pinned`: it was running this already and goes on.

    `performance` is the declared one, or what a feature has put in its place.
    `leader` brings the party together, where robots carry out the task jointly; `round` counts the
    parties that have ended without success. `values`: blackboard entry -> its value,
    of those that are arguments.
    """

    robot: str
    activation: str
    global_task: str
    local_task: str
    performance: int
    pinned: bool
    leader: str = ""
    round: int = 0
    values: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class PendingFailure:
    """A request that fails if every plan shows it for `after_us` (None: `Timing.failure_latch_us`).

    Some robot has failed, and no living robot can make it good.
    """

    activation: str
    after_us: int | None

    @property
    def fact_name(self) -> str:
        """The fact that it has failed."""
        return f"{records.LATCHED_FAILURE}/{self.activation}"


# How an obstacle begins that only an operator's decision removes.
UNDECIDED = "in doubt"


@dataclass(frozen=True, slots=True)
class PendingLoss:
    """A condition that becomes false, or an entry that is not set any more, if every plan shows it
    for `Timing.failure_latch_us`: a robot outside the team had it. `changes`: how often it has
    changed then.
    """

    condition: str
    changes: int
    value: Value | None = False

    @property
    def fact(self) -> Fact:
        """The fact that it is lost; the same, whichever robot writes it."""
        return f"{records.CONDITION}/{self.condition}", ConditionValue(self.value, self.changes, 0)


@dataclass(frozen=True, slots=True)
class Waiting:
    """A request that is not served. With `shortages` it is blocked: no living robots could.

    `obstacle` is what else keeps it from being served, whichever robots are free. `held_by`: the
    blackboard entries that are not set, or the side constraints without which it would not have to
    wait now. `awaited`: the robots of which something is awaited before it is decided who serves
    it, which is called `awaited_things`. `is_failing`: it fails unless that changes.
    """

    activation: str
    global_task: str
    shortages: tuple[Shortage, ...]
    obstacle: str = ""
    held_by: str = ""
    awaited: tuple[str, ...] = ()
    is_failing: bool = False
    awaited_things: str = ""

    @property
    def is_blocked(self) -> bool:
        """Whether it waits for more than for busy robots."""
        return bool(self.shortages or self.obstacle)

    @property
    def reason(self) -> str:
        """For people: `blocked: move_frame needs 2, 1 alive`."""
        end = "; fails unless that changes" if self.is_failing else ""
        if self.obstacle:
            return f"blocked: {self.obstacle}{end}"
        if self.held_by:
            return f"waiting: {self.held_by}"
        if self.awaited:
            return f"waiting for {self.awaited_things} of {shortened(self.awaited)}"
        if not self.shortages:
            return "waiting: the robots it needs are busy with earlier requests"
        return "blocked: " + "; ".join(map(str, self.shortages)) + end


@dataclass(frozen=True, slots=True)
class DemandBounds:
    """How many robots a local task of a request is to have now, at least and at most.

    `lower` and `upper` are a_j and b_j (paper, section V): min and max of the mission file, less
    by the outcomes so far. `robots` are those that the plan has on it.
    """

    activation: str
    global_task: str
    local_task: str
    lower: int
    upper: int
    robots: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self) | {"robots": list(self.robots)}


@dataclass(frozen=True)
class Plan:
    """`assignments` by robot; `idle`: the robots without one, then those that are alive and that
    the plan may not use; the rest is in tree order.

    The demands, those of them that are `kept`, by their index, and what lies `ahead` in a mission
    that travels, are the input of the plan and no part of its content. `parts`: what features add,
    by the names of these parts.

    What the leaves of T_A return (paper, section V): *Check Consistency* holds if `consistent`, so
    unless there are requests and none of them can be served; *Assign Agents* succeeds if
    `feasible`, so if the assignment problem, equation (2), has a solution. A request that waits is
    no part of the problem, unless all of them wait.

    `ended`: how the mission has ended, None if it has not. T_G may have ended before the team
    agrees on that, and may read otherwise afterwards. `mission_number`: the mission's
    `number`.
    """

    evaluation: Evaluation
    command: TeamOrder
    assignments: Mapping[str, RobotAssignment]
    idle: tuple[str, ...]
    waiting: tuple[Waiting, ...]
    consistent: bool = True
    feasible: bool = True
    parts: Mapping[str, PlanPart] = field(default_factory=dict)
    demands: Sequence[Group] = field(default=(), compare=False, repr=False)
    pending_failures: tuple[PendingFailure, ...] = ()
    pending_losses: tuple[PendingLoss, ...] = ()
    ended: Status | None = None
    mission_number: int = 0
    ahead: Lookahead | None = field(default=None, compare=False, repr=False)
    kept: Collection[int] = field(default=(), compare=False, repr=False)

    @cached_property
    def result(self) -> Status:
        """T_G's status until the mission has ended; FAILURE once the operator has aborted."""
        if self.command is TeamOrder.ABORT:
            return Status.FAILURE
        return self.evaluation.status if self.ended is None else self.ended

    @property
    def is_final(self) -> bool:
        """Whether the result stays as it is, whatever conditions turn."""
        return self.ended is not None or self.command is TeamOrder.ABORT

    def is_about_to_end(self, mission: Mission) -> bool:
        """Whether T_G has ended, so that the mission has too once all robots agree on it."""
        is_over = self.result in (Status.SUCCESS, Status.FAILURE)
        return is_over and not self.is_final and mission.ends is MissionEnd.ONCE

    @cached_property
    def digest(self) -> bytes:
        """8 bytes over activation -> robots alone, and what is read from the blackboard for it: no
        phases, no pins, not the alive set. Where the mission has taken the place of others also
        over its number: robots that follow different ones do not agree.

        Once the mission has ended, over how it did.
        """
        said: Sequence[Any] = (
            [int(self.result)]
            if self.ended is not None
            else sorted(
                (x.activation, x.local_task, x.robot, x.round, *x.values)
                for x in self.assignments.values()
            )
        )
        if self.mission_number and self.ended is None:
            said = [self.mission_number, *said]
        return hashlib.blake2b(msgpack.packb(said), digest_size=8).digest()

    @cached_property
    def packed(self) -> bytes:
        """The whole plan as bytes; equal on all robots with the same facts and alive set."""
        return bytes(msgpack.packb(self.to_json()))

    @property
    def bounds(self) -> tuple[DemandBounds, ...]:
        """a_j and b_j of every local task that is requested, in tree order."""
        working: dict[tuple[str, str], list[str]] = {}
        for each in self.assignments.values():
            working.setdefault((each.activation, each.local_task), []).append(each.robot)
        return tuple(
            DemandBounds(
                demand.request.activation,
                demand.request.subject,
                demand.local_task,
                demand.lower,
                demand.upper,
                tuple(working.get((demand.request.activation, demand.local_task), ())),
            )
            for group in self.demands
            for demand in group
        )

    def partners(self, robot: str) -> tuple[str, ...]:
        """The other robots on the same local task of the same activation."""
        mine = self.assignments[robot]
        key = (mine.activation, mine.local_task)
        return tuple(
            x.robot
            for x in self.assignments.values()
            if (x.activation, x.local_task) == key and x.robot != robot
        )

    def to_json(self) -> dict[str, Any]:
        """Plain data, in a fixed order."""
        return {
            "result": self.result.name.lower(),
            "command": str(self.command),
            "feasible": self.feasible,
            "statuses": list(self.evaluation.statuses),
            "requests": [[r.subject, r.activation] for r in self.evaluation.requests],
            "lines": {
                x.robot: {
                    "activation": x.activation,
                    "global_task": x.global_task,
                    "local_task": x.local_task,
                    "performance": x.performance / 1e6,
                    "pinned": x.pinned,
                    "leader": x.leader or None,
                    "round": x.round,
                }
                | ({"values": dict(x.values)} if x.values else {})
                for x in self.assignments.values()
            },
            "idle": list(self.idle),
            "waiting": [
                {"activation": w.activation, "global_task": w.global_task, "blocked": w.is_blocked}
                for w in self.waiting
            ],
            **{
                name: self.parts[name].to_json() if name in self.parts else []
                for name in filter(None, (feature.in_plan for feature in features()))
            },
            "pending_failures": [failure.activation for failure in self.pending_failures],
            "pending_losses": [loss.condition for loss in self.pending_losses],
        }


def assignment_reason(plan: Plan, robot: str) -> str:
    """Why a robot has its assignment, for people."""
    assignment = plan.assignments[robot]
    why = "part of the best assignment"
    if assignment.pinned:
        why = "goes on with what it runs"
    elif plan.ahead is not None and plan.ahead.is_next(robot, assignment.activation):
        why = "next in the schedule in force"
    why += "".join(f" with {name} = {value}" for name, value in assignment.values)
    texts = (part.performance_text(assignment) for part in plan.parts.values())
    text = next(filter(None, texts), f"performance {assignment.performance / MICRO:g}")
    return f"{why} ({text})"
