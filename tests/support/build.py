"""Small words for building trees, missions and facts in tests."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.agent.operator_messages import command_version
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Evaluation, OutcomeTick
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status, build_tree
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    ABORTED,
    PAUSED,
    Claim,
    Member,
    Phase,
    Record,
    TeamOrder,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.feature import JointPolicy
from mrbt_mesh.core.membership.keys import make_command
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.core.mission.mission import (
    MICRO,
    GlobalTask,
    LocalTask,
    Mission,
    Need,
    Robot,
)
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.idle import why_idle

if TYPE_CHECKING:
    from mrbt_mesh.features.exclusive.records import CoalitionId

# Fields of a task that say how robots carry it out jointly.
_JOINT = ("simultaneous", "exclusive", "in_doubt", "begin_within_us")
RUN = "r1"
SECOND_US = 1_000_000


# -- trees ------------------------------------------------------------------------------------


def sequence(*children: NodeSpec, name: str = "") -> NodeSpec:
    return NodeSpec(Kind.SEQUENCE, children, name)


def fallback(*children: NodeSpec, name: str = "") -> NodeSpec:
    return NodeSpec(Kind.FALLBACK, children, name)


def parallel(needed: int, *children: NodeSpec) -> NodeSpec:
    return NodeSpec(Kind.PARALLEL, children, limit=needed)


def action(subject: str) -> NodeSpec:
    return NodeSpec(Kind.ACTION, subject=subject)


def condition(subject: str) -> NodeSpec:
    return NodeSpec(Kind.CONDITION, subject=subject)


def decorated(kind: Kind, child: NodeSpec) -> NodeSpec:
    return NodeSpec(kind, (child,))


def inverter(child: NodeSpec) -> NodeSpec:
    return decorated(Kind.INVERTER, child)


def retry(limit: int, child: NodeSpec) -> NodeSpec:
    return NodeSpec(Kind.RETRY, (child,), limit=limit)


def repeat(limit: int, child: NodeSpec) -> NodeSpec:
    return NodeSpec(Kind.REPEAT, (child,), limit=limit)


def keep_running(child: NodeSpec) -> NodeSpec:
    return decorated(Kind.KEEP_RUNNING_UNTIL_FAILURE, child)


def timeout(seconds: float, child: NodeSpec) -> NodeSpec:
    return NodeSpec(Kind.TIMEOUT, (child,), timeout_us=round(seconds * SECOND_US))


def leaves(spec: NodeSpec, kind: Kind) -> list[str]:
    """Subjects of the leaves of one kind, in tree order, each once."""
    if spec.kind is kind:
        return [spec.subject]
    found = (name for child in spec.children for name in leaves(child, kind))
    return list(dict.fromkeys(found))


# -- missions ---------------------------------------------------------------------------------


def task(name: str, *needs: tuple[Any, ...], **policies: Any) -> GlobalTask:
    """A global task; without `needs` one robot does the local task of the same name.

    A need is (local task, min, max), or with bids (local task, min, max, True[, within_us]).
    `policies`: as in `GlobalTask`, or in `jointly`.
    """
    rows = needs or ((name, 1, 1),)
    joint = {key: policies.pop(key) for key in _JOINT if key in policies}
    return GlobalTask(name, tuple(_need(*row) for row in rows), **policies, joint=jointly(**joint))


def jointly(**policy: Any) -> JointPolicy | None:
    """How a `simultaneous` or `exclusive` task is carried out; None if it is neither."""
    if not (policy.get("simultaneous") or policy.get("exclusive")):
        return None
    from mrbt_mesh.features.exclusive.policy import CoalitionPolicy

    return CoalitionPolicy(**policy)


def _need(local_task: str, least: int, most: int, *bid: Any) -> Need:
    if not bid:
        return Need(local_task, least, most)
    # Loaded here, as by all below: the kernel's own tests run without features.
    from mrbt_mesh.features.bids.needs import BidRule

    return Need(local_task, least, most, None, BidRule(*bid[1:]))


def make_mission(
    tree: NodeSpec,
    robots: Mapping[str, Mapping[str, float]] | None = None,
    tasks: Iterable[GlobalTask] = (),
    true_at_first: Sequence[str] = (),
    name: str = "m",
) -> Mission:
    """A mission around a tree: what is not given follows from the tree's leaves."""
    known = {each.id: each for each in tasks}
    for subject in leaves(tree, Kind.ACTION):
        known.setdefault(subject, task(subject))
    types = sorted({type_name(n.local_task) for each in known.values() for n in each.needs})
    team = robots if robots is not None else {"R1": dict.fromkeys(types, 1)}
    return Mission(
        name=name,
        robots={robot: Robot(robot, "T", micro(can)) for robot, can in team.items()},
        robot_types={"T": {}},
        local_tasks={each: LocalTask(each) for each in types},
        conditions={
            each: ConditionType(each, default=each in true_at_first)
            for each in leaves(tree, Kind.CONDITION)
        },
        global_tasks=known,
        tree=build_tree(tree),
    )


def micro(capabilities: Mapping[str, float]) -> dict[str, int]:
    return {name: round(value * MICRO) for name, value in capabilities.items()}


# -- facts ------------------------------------------------------------------------------------


def refusal(facts: TeamFacts, entry: Entry) -> str | None:
    """Why these facts would not take in an entry, None if they would."""
    return refusal_reason(entry, facts.mission, facts.run)


class World:
    """A team's facts, written as its robots would write them.

    `entries` keeps everything that was ever written, so that a test can deliver it again in
    another order.
    """

    def __init__(
        self, mission: Mission | NodeSpec, true_at_first: Sequence[str] = (), joined: bool = True
    ) -> None:
        if isinstance(mission, NodeSpec):
            mission = make_mission(mission, true_at_first=true_at_first)
        self.mission = mission
        self.facts = TeamFacts(mission, RUN)
        self.evaluator = Evaluator(mission.tree)
        self.entries: list[Entry] = []
        self.alive: dict[str, Incarnation] = {}
        self._sequence = 0
        if joined:
            for robot in mission.robots.values():
                self.join(robot.id, robot.capabilities)

    def write(self, author: str, *values: tuple[str, Any]) -> None:
        """One batch of an author: names with records, or with their values."""
        self._sequence += 1
        version = Version(self.alive.get(author, Incarnation(1, "n")), self._sequence)
        rows = [(n, v.to_value() if isinstance(v, Record) else v) for n, v in values]
        batch = [parse_entry(author, name, version, value) for name, value in rows]
        refusals = [refusal(self.facts, entry) for entry in batch]
        assert not any(refusals), refusals
        self.entries += batch
        self.facts.map.merge(batch)

    def join(
        self, robot: str, capabilities: Mapping[str, int], lost: tuple[str, ...] = (), life: int = 1
    ) -> None:
        """A robot's description of itself, under a new incarnation where `life` is new."""
        self.alive[robot] = Incarnation(life, "n")
        member = Member("T", capabilities, dict.fromkeys(lost, ""), False, "", "", 0)
        self.write(robot, (records.MEMBER, member))

    def lose(self, robot: str, *local_tasks: str) -> None:
        """A minor fault."""
        self.join(robot, self.facts.members[robot].member.capabilities, local_tasks)

    def leave(self, robot: str) -> None:
        """A robot hands its work over."""
        member = self.facts.members[robot].member
        row = Member("T", member.capabilities, member.lost, True, "", "", 0)
        self.write(robot, (records.MEMBER, row), (records.CLAIM, None))

    def die(self, robot: str) -> None:
        """Others stop counting on it; its facts stay."""
        del self.alive[robot]

    def set(self, name: str, value: bool, author: str = "R1") -> None:
        """Someone sees a condition change; nothing is written where it is so already."""
        if self.facts.condition(name) != value:
            row = [value, self.facts.conditions.changes(name) + 1, self.facts.max_stamp + 1]
            self.write(author, (f"{records.CONDITION}/{name}", row))

    def outcome(self, activation: str, success: bool, robot: str = "R1", local: str = "") -> None:
        """A robot finishes its part of an activation; it may be a straggler."""
        local = local or parse_activation(activation).subject
        self.write(robot, (f"{records.OUTCOME}/{activation}/{local}", [success, None]))

    def bid(self, robot: str, activation: str, local: str, performance: float | None) -> None:
        """A robot bids for a local task of an activation."""
        from mrbt_mesh.features.bids.needs import BID

        value = None if performance is None else round(performance * MICRO)
        self.write(robot, (f"{BID}/{activation}/{local}", value))

    def close(self, activation: str, local: str, robot: str = "R1") -> None:
        """A robot has seen the time for bids pass."""
        from mrbt_mesh.features.bids.needs import CLOSED

        self.write(robot, (f"{CLOSED}/{activation}/{local}", True))

    def claim(
        self, robot: str, activation: str, local: str = "", running: bool = True, since: int = 1
    ) -> None:
        """A robot works on an activation."""
        subject = parse_activation(activation).subject
        phase = Phase.RUNNING if running else Phase.CLAIMED
        claim = Claim(activation, subject, local or subject, phase, since)
        self.write(robot, (records.CLAIM, claim))

    def ready(self, robot: str, activation: str, local: str = "", since: int = 1) -> None:
        """A robot is ready to start with a coalition."""
        subject = parse_activation(activation).subject
        claim = Claim(activation, subject, local or subject, Phase.READY, since)
        self.write(robot, (records.CLAIM, claim))

    def form(self, activation: str, *robots: str, since: int = 1, local: str = "") -> CoalitionId:
        """The first of these robots writes down the coalition, and all of them start."""
        from mrbt_mesh.features.exclusive.coalitions import ready_members
        from mrbt_mesh.features.exclusive.kinds import COALITION
        from mrbt_mesh.features.exclusive.records import Coalition, CoalitionId

        local = (
            local
            or self.mission.global_tasks[parse_activation(activation).subject].needs[0].local_task
        )
        for robot in robots:
            self.ready(robot, activation, local, since)
        members = ready_members(self.facts, activation, dict.fromkeys(robots, local))
        token = CoalitionId(since, robots[0], *self.alive[robots[0]])
        name = f"{COALITION}/{activation}/{token}"
        self.write(robots[0], (name, Coalition(tuple(members))))
        for robot in robots:
            self.go(robot, activation, token, local)
        return token

    def go(self, robot: str, activation: str, token: CoalitionId, local: str) -> None:
        """A member starts."""
        subject = parse_activation(activation).subject
        claim = Claim(activation, subject, local, Phase.RUNNING, token.since, str(token))
        self.write(robot, (records.CLAIM, claim))

    def end(
        self, activation: str, token: CoalitionId, robot: str, success: bool, local: str
    ) -> None:
        """A member finishes its part."""
        name = f"{records.OUTCOME}/{activation}/{local}/{token}"
        self.write(robot, (name, [success, None]), (records.CLAIM, None))

    def say(self, kind: str, activation: str, token: CoalitionId, *authors: str) -> None:
        """Robots latch something about a coalition."""
        for author in authors:
            self.write(author, (f"{kind}/{activation}/{token}", True))

    def command(self, name: str, value: Any, stamp: int = 1, command_id: str = "c") -> None:
        """An operator commands a field of a subject."""
        version = command_version(stamp, command_id)
        self.facts.map.merge([make_command(name, value, "op", version, RUN, None)])

    def order(self, order: str, stamp: int = 1, command_id: str = "c") -> None:
        """An operator pauses, resumes or aborts the team."""
        name, value = (ABORTED, True) if order == TeamOrder.ABORT else (PAUSED, order)
        self.command(name, value, stamp, command_id)

    # -- reading it ---------------------------------------------------------------------------

    def tick(self) -> Evaluation:
        """Evaluate, and record what has become true, as every agent does."""
        while True:
            while turned := self.facts.turned_guards():
                self.write("R1", *((f"{records.EXPRESSION}/{n}", v) for n, v in turned))
            evaluation = self.evaluator.evaluate(self.facts)
            if not self._latch(evaluation):
                return evaluation

    def returns(
        self, activation: str, success: bool, conditions: Mapping[str, bool], robot: str = "R1"
    ) -> Status:
        """An action returns that has set conditions, which are still to be written.

        The root's status in the tick in which it does.
        """
        name = f"{records.OUTCOME}/{activation}/{parse_activation(activation).subject}"
        version = Version(self.alive[robot], self._sequence + 1)
        status = self.facts.status_after(name, robot, success, version)
        after = self.facts.conditions.after(conditions)
        evaluation = self.evaluator.evaluate(OutcomeTick(self.facts, activation, status, after))
        self.outcome(activation, success, robot)
        self._latch(evaluation)
        return evaluation.status

    def _latch(self, evaluation: Evaluation) -> bool:
        """Record what has become true; whether anything has."""
        latches = [(f"{records.ATTEMPT}/{s}", n) for s, n in evaluation.attempts]
        latches += [
            (f"{records.LATCHED_FAILURE}/{activation}", True)
            for activation in evaluation.failures
            if not self.facts.has_latched_failure(activation)
        ]
        latches += [
            (f"{records.CHILD_RESULT}/{scope}/{position}", success)
            for scope, position, success in evaluation.child_results
        ]
        if latches:
            self.write("R1", *latches)
        return bool(latches)

    @property
    def status(self) -> Status:
        """The root's status."""
        return self.tick().status

    def asked(self) -> list[str]:
        """Subjects of the requests, in order."""
        return [request.subject for request in self.tick().requests]

    def activation(self, subject: str) -> str:
        """The activation under which a subject is requested now."""
        (found,) = (r.activation for r in self.tick().requests if r.subject == subject)
        return found

    def succeed(self, subject: str, robot: str = "R1") -> None:
        """The requested activation of a subject succeeds."""
        self.outcome(self.activation(subject), True, robot)

    def fail(self, subject: str, robot: str = "R1") -> None:
        self.outcome(self.activation(subject), False, robot)

    def expire(self) -> None:
        """The deadlines of all running Timeouts pass."""
        for running in self.tick().timeouts:
            self.write("R1", (f"{records.EXPIRED}/{running.activation}", True))

    def plan(self) -> Plan:
        return make_plan(self.facts, self.alive, min_cost_flow)

    def idle(self) -> dict[str, str]:
        return why_idle(self.plan(), self.facts, self.alive)

    def replayed(self, entries: Iterable[Entry]) -> World:
        """Another replica that received these entries in this order."""
        other = World(self.mission, joined=False)
        other.alive = dict(self.alive)
        for entry in entries:
            other.facts.map.merge([entry])
        return other
