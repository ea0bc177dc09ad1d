"""The mission: robots, local tasks, global tasks and the team's tree T_G, all ground.

Files with parameters and for-each loops are expanded by `mrbt_mesh.formats`; what arrives
here has none left. Every robot of a team holds the same mission, and `Mission.digest`
shows it. Source: paper, section IV; symbols in ARCHITECTURE.md's glossary.
"""

from __future__ import annotations

import enum
import hashlib
import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar, TypeAlias

from mrbt_mesh.core.assignment.solve import needs_arrays
from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Expression, Guard
from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Tree, build_tree
from mrbt_mesh.core.codec import IN_ORDER, KEY, Codec, StandIn, TypesByName
from mrbt_mesh.core.feature import (
    JointPolicy,
    Limits,
    PerformanceRule,
    PlanStep,
    Succession,
    classes_of,
    features,
    section_type,
    used,
)
from mrbt_mesh.core.mission.conditions import ConditionType, Value
from mrbt_mesh.core.mission.names import (
    bound,
    declared_name,
    entries_in,
    placeholder,
    split_call,
    type_name,
)
from mrbt_mesh.core.mission.program_trees import (
    ProgramTree,
    SharedTrees,
    shared_trees,
)
from mrbt_mesh.core.mission.travel import Travel

MICRO = 1_000_000
MAX_PERFORMANCE = 1_000_000 * MICRO
MAX_ROBOTS = 1_000
MAX_GLOBAL_TASKS = 10_000
MAX_COST = 1_000_000
MAX_JOB_TYPES = 100
MAX_CHOICES = 10_000
MAX_PRIORITY = 1_000
MAX_AT_MOST = 1_000
MAX_NUMBER = 1_000_000_000
COMPILED_VERSION = 4

_NUMBER = re.compile(r"0|-?[1-9][0-9]{0,9}")


def is_whole_number(text: str) -> bool:
    """Whether a text is a whole number as arguments of jobs write it."""
    return _NUMBER.fullmatch(text) is not None


def whole(given: Any) -> Any:
    """JSON has one kind of numbers: 3.0 is a whole one. Anything else is left as it is."""
    return int(given) if isinstance(given, float) and given.is_integer() else given


RobotId: TypeAlias = str
LocalTaskId: TypeAlias = str
GlobalTaskId: TypeAlias = str


class FailurePolicy(enum.StrEnum):
    """When a global task fails: by the paper's count, at the first failure, once none may try."""

    PAPER = "paper"
    FIRST = "first"
    RESILIENT = "resilient"


class MissionEnd(enum.StrEnum):
    """Whether a team stops when T_G has succeeded or failed, or stands by."""

    ONCE = "once"
    NEVER = "never"


class Recorded(enum.StrEnum):
    """What a robot needs its own recording for: nothing, or tasks that are done at most once."""

    IF_POSSIBLE = "if_possible"
    REQUIRED = "required"


@dataclass(frozen=True, slots=True)
class LocalTask:
    """A local-task type: its parameters, and its nominal work in micro-units.

    A robot with performance p needs work / p seconds for it.
    """

    name: str = field(metadata=KEY)
    parameters: tuple[str, ...] = ()
    work: int = MICRO


@dataclass(frozen=True, slots=True)
class Costs:
    """The costs of one more robot of a type, and of one more robot with a capability; usually 1.

    Only `mrbt analyze` reads them.
    """

    robots: Mapping[str, int] = field(default_factory=dict)
    capabilities: Mapping[str, int] = field(default_factory=dict)

    def robot(self, robot_type: str) -> int:
        """The cost of one more robot."""
        return self.robots.get(robot_type, 1)

    def capability(self, local_task: str) -> int:
        """The cost of making one robot capable."""
        return self.capabilities.get(local_task, 1)


@dataclass(frozen=True, slots=True)
class SameRobotAs:
    """A local task of another global task, both ground."""

    global_task: GlobalTaskId
    local_task: LocalTaskId


@dataclass(frozen=True, slots=True)
class Need:
    """One local task of psi(g) with its bounds nu (`min_robots`) and mu (`max_robots`).

    With nu = 0 helpers are optional; a task has another need with nu > 0.
    `same_robot_as`: only robots that have succeeded with that before are assigned.
    `performance_rule`: from what performances follow, None if they are as declared. `after`:
    ` that did pick(1) of fetch(1)`, empty if any robot will do.
    """

    local_task: LocalTaskId
    min_robots: int
    max_robots: int
    same_robot_as: SameRobotAs | None = None
    performance_rule: PerformanceRule | None = None
    after: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        before = self.same_robot_as
        after = f" that did {before.local_task} of {before.global_task}" if before else ""
        object.__setattr__(self, "after", after)


@dataclass(frozen=True, slots=True)
class GlobalTask:
    """A ground global task g: psi(g) and its policies.

    `failure_after_us`: for how long the team must agree that no living robot can make good a
    failure; None: `Timing.failure_latch_us`. `blocked_fail_after_us`: None waits for robots to
    return; otherwise the task fails after it has been blocked that long. `joint`: how its robots
    carry it out jointly, None if they work each on its own. `effects`: ground conditions and the
    values that they are declared to have once it has succeeded; only checks and analysis read them.
    `reads`: the blackboard entries that are arguments of its local tasks.
    """

    id: GlobalTaskId = field(metadata=KEY)
    needs: tuple[Need, ...]
    failure: FailurePolicy = FailurePolicy.RESILIENT
    blocked_fail_after_us: int | None = None
    preemptive: bool = False
    joint: JointPolicy | None = None
    failure_after_us: int | None = None
    effects: tuple[tuple[str, bool], ...] = ()
    reads: tuple[str, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        read = {name for need in self.needs for name in entries_in(need.local_task)}
        object.__setattr__(self, "reads", tuple(sorted(read)))

    @property
    def at_most_once(self) -> bool:
        """Whether it is never done twice, nor by two groups of robots at the same time."""
        return self.joint is not None and self.joint.at_most_once

    def need(self, local_task: LocalTaskId) -> Need | None:
        """Its need of a local task, None if it has none."""
        return next((need for need in self.needs if need.local_task == local_task), None)


@dataclass(frozen=True, slots=True)
class JobParameter:
    """A parameter of a job type: one of `choices`, or a whole number from `low` to `high`."""

    name: str
    choices: tuple[str, ...] = ()
    low: int = 0
    high: int = 0

    def problem(self, value: str) -> str:
        """What is wrong with a value; empty if it fits."""
        if self.choices:
            listed = ", ".join(self.choices[:20]) + (", ..." if len(self.choices) > 20 else "")
            return "" if value in self.choices else f"{self.name} is one of {listed}"
        is_number = is_whole_number(value) and self.low <= int(value) <= self.high
        return "" if is_number else f"{self.name} is a whole number from {self.low} to {self.high}"

    def longest(self) -> str:
        """A value with the most characters."""
        return max(self.choices or (str(self.high), str(self.low)), key=len)

    def values(self) -> Iterator[str]:
        """All of them."""
        return iter(self.choices) if self.choices else map(str, range(self.low, self.high + 1))


@dataclass(frozen=True, slots=True)
class JobType:
    """A type of jobs.

    `ends_mission`: the Jobs node ends with the first job of this type that ends, as it did.
    `deadline_us`: how long after its submission a job expires, unless it says so itself; None:
    never. The rest holds what its tree needs with placeholders in their names, as `Mission` has it
    for ground names; `at` as in `Travel`.
    """

    name: str = field(metadata=KEY)
    parameters: tuple[JobParameter, ...] = ()
    priority: int = 0
    deadline_us: int | None = None
    ends_mission: bool = False
    global_tasks: Annotated[Mapping[str, GlobalTask], IN_ORDER] = field(default_factory=dict)
    at: Mapping[str, str] = field(default_factory=dict)
    program_trees: Mapping[str, ProgramTree] = field(default_factory=dict)

    def problem(self, arguments: Sequence[str]) -> str:
        """What is wrong with the arguments of a job; empty if they fit."""
        if len(arguments) != len(self.parameters):
            wanted = ", ".join(each.name for each in self.parameters) or "none"
            count = len(self.parameters)
            return f"{self.name} takes {count} argument{'' if count == 1 else 's'} ({wanted})"
        pairs = zip(self.parameters, arguments, strict=True)
        problems = (each.problem(value) for each, value in pairs)
        return next(filter(None, problems), "") or self._needed_twice(arguments)

    def _needed_twice(self, arguments: Sequence[str]) -> str:
        """Two needs of one task may become the same: whether they do."""
        values = self.values_of(arguments)
        for task in self.global_tasks.values():
            needed = [bound(need.local_task, values) for need in task.needs]
            twice = next((name for name in needed if needed.count(name) > 1), None)
            if twice is not None:
                return f"{bound(task.id, values)} would need {twice} twice"
        return ""

    def values_of(self, arguments: Sequence[str]) -> dict[str, str]:
        """Parameter -> the value that a job gives it."""
        return {p.name: value for p, value in zip(self.parameters, arguments, strict=True)}

    def values(self, text: str) -> Iterator[str]:
        """All that a text with placeholders can become, which may be many."""
        used = next((each for each in self.parameters if placeholder(each.name) in text), None)
        if used is None:
            yield text
            return
        for value in used.values():
            yield from self.values(text.replace(placeholder(used.name), value))

    def places(self) -> Iterator[tuple[str, str]]:
        """Local tasks, with placeholders, and the places where each may happen."""
        return ((task, place) for task, at in self.at.items() for place in self.values(at))


@dataclass(frozen=True, slots=True)
class Robot:
    """A robot of the mission file: capabilities L_i with performance p(i, l) in micro-units."""

    id: RobotId = field(metadata=KEY)
    type: str
    capabilities: Mapping[str, int]


def majority(robots: Collection[RobotId]) -> int:
    """How many of these robots are more than half of them, and no more than that takes."""
    return len(robots) // 2 + 1


def performance(capabilities: Mapping[str, int], local_task: LocalTaskId) -> int | None:
    """p(i, l) in micro-units, None where l is not in L_i (the paper's minus infinity).

    A capability for the ground local task goes before one for its type.
    """
    exact = capabilities.get(local_task)
    return exact if exact is not None else capabilities.get(type_name(local_task))


def travel_problems(
    travel: Travel, robots: Iterable[Robot], jobs: Iterable[JobType]
) -> Iterator[tuple[str, str]]:
    """What robots lack that can do something at a place: their `start`, or a way to it (`ways`).

    The first of each robot type, and what kind it is.
    """
    seen = set[tuple[str, str | None, frozenset[str]]]()
    at = [*travel.at.items()]
    at += [pair for job in jobs for pair in job.places()]
    found = set[str]()
    for robot in robots:
        able = robot.capabilities
        goals = frozenset(p for task, p in at if performance(able, task) is not None)
        start = travel.start.get(robot.id)
        if not goals or robot.type in found or (robot.type, start, goals) in seen:
            continue
        seen.add((robot.type, start, goals))
        if start is None:
            found.add(robot.type)
            yield "start", f"{robot.id} can work at places; say where it is at first"
        elif problem := travel.way_problem(robot.type, start, goals):
            found.add(robot.type)
            yield "ways", problem


def micro_performance(value: float) -> int:
    """A performance in micro-units, as a robot or an operator declares it; 0: it cannot do it.

    Raises ValueError for anything but a number from 0 to 1e6.
    """
    most = MAX_PERFORMANCE // MICRO
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= most:
        raise ValueError(f"a performance is a number from 0 to {most}, not {value!r:.80}")
    return round(value * MICRO)


class MissionEntries:
    """The conditions of one mission, and how its tree reads them. A feature may have other entries,
    and other names for them (`Feature.entries`).

    `declared`: conditions and other entries, by type. `robots`: those of the mission, sorted.
    `has_values`: there are entries that are neither true nor false. `leaves`: what the tree reads
    that each robot has for itself, sorted, and `read` the entries that these leaves read. `guards`:
    by action node, its guards that a robot reads its own way.
    """

    has_values = False
    leaves: Sequence[str] = ()
    read: Sequence[str] = ()
    guards: Mapping[int, tuple[Guard, ...]] = {}
    is_plain: ClassVar[bool] = True

    def __init__(
        self, declared: Mapping[str, ConditionType], robots: Sequence[str], names: ActivationNames
    ) -> None:
        self.declared = declared
        self.robots = robots
        self.names = names

    # -- names --------------------------------------------------------------------------------

    def knows(self, ground: str) -> bool:
        """Whether `ground` is a declared condition or entry, with its number of arguments."""
        try:
            name, arguments = split_call(ground)
        except ValueError:
            return False
        known = self.declared.get(name)
        return known is not None and len(known.parameters) == len(arguments)

    def is_condition(self, ground: str) -> bool:
        """Whether a leaf may read `ground`."""
        return self.knows(ground)

    def can_be_set(self, name: str) -> bool:
        """Whether this is a condition or entry that facts may set."""
        return self.knows(name)

    def is_value(self, ground: str) -> bool:
        """Whether this is an entry that is neither true nor false."""
        return False

    def is_own(self, ground: str) -> bool:
        """Whether every robot has its own value, by the name that a leaf reads."""
        return False

    def of(self, robot: str, name: str, job: str = "") -> str:
        """A condition or entry as a robot's program names it in a task of this job: the robot's or
        the job's own, if every robot or job has its own.
        """
        return name

    def called(self, name: str) -> str:
        """What to call a declared one for people."""
        return f"condition {name}"

    # -- values -------------------------------------------------------------------------------

    def default_of(self, ground: str) -> Value | None:
        """The value of a condition or another entry while nobody has set it; None: it has none."""
        known = self.declared.get(declared_name(ground))
        return known.default if known is not None else None

    def default(self, ground: str) -> bool:
        """Whether `ground` holds while nobody has set anything; False if it is not declared."""
        return bool(self.default_of(ground))

    def problem(self, name: str, value: Any) -> str:
        """What is wrong with a value for a condition or entry; empty if it fits. None: not set."""
        return "" if isinstance(value, bool) else "it is true or false"

    def text(self, ground: str, value: Value | None) -> str:
        """A value of an entry, or a condition, as an argument and for people."""
        return "not set" if value is None else str(value).lower()

    def samples(self, name: str) -> Sequence[str]:
        """Arguments to check for all values of a declared entry; empty if there are none."""
        return ()

    def derived(
        self, name: str, holds: Callable[[str], bool], value: Callable[[str], Value | None]
    ) -> bool | None:
        """Whether a condition holds that follows from others or from an entry; None: it is set
        itself. `holds` and `value` read conditions and entries.
        """
        return None

    # -- the tree -----------------------------------------------------------------------------

    @property
    def expressions(self) -> Mapping[str, Expression]:
        """The expressions that are guards, by id."""
        return self.names.expressions

    def expression_of_job(self, name: str) -> Expression | None:
        """The expression of this id in the tree of a job that may not be known here yet."""
        return None

    def read_by(self, guard: str) -> tuple[str, ...]:
        """The conditions that a guard of several nodes reads, as the tree names them."""
        known = self.names.with_actions.get(guard)
        return known.conditions if known is not None else self.expressions[guard].conditions


@dataclass(frozen=True)
class Mission:
    """Everything that all robots of a team must agree on before they start.

    `parameters` are the file's values, for robots' programs to read; `program` names the
    default robot program, relative to the mission file. It, `costs` and `solver` are no part of
    the digest: robots with different solvers make the same plans. `program_trees`: those of ground
    local tasks that are BehaviorTree.CPP trees. `travel`: None where nothing is said of places.
    `jobs`: types of jobs, whose trees are below Jobs nodes. `recorded`: whether robots that do not
    record take tasks that are done at most once. `sections`: what features add (`core.feature`), by
    the names of their sections.
    """

    name: str
    robots: Mapping[RobotId, Robot]
    robot_types: Mapping[str, Mapping[str, int]]
    local_tasks: Mapping[str, LocalTask]
    conditions: Mapping[str, ConditionType]
    global_tasks: Annotated[Mapping[GlobalTaskId, GlobalTask], IN_ORDER]
    tree: Tree
    parameters: Mapping[str, Any] = field(default_factory=dict)
    program: str | None = None
    costs: Costs = field(default_factory=Costs)
    solver: str | None = None
    ends: MissionEnd = MissionEnd.ONCE
    recorded: Recorded = Recorded.IF_POSSIBLE
    program_trees: Mapping[LocalTaskId, ProgramTree] = field(default_factory=dict)
    travel: Travel | None = None
    jobs: Mapping[str, JobType] = field(default_factory=dict)
    sections: Annotated[Mapping[str, Any], TypesByName(section_type)] = field(default_factory=dict)

    @cached_property
    def evaluator(self) -> Evaluator:
        """Evaluates the mission's tree, by the definition."""
        return Evaluator(self.tree)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the canonical form, 64 hexadecimal digits."""
        agreed = replace(self, program=None, solver=None, costs=Costs()).to_json()
        text = json.dumps(agreed, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def succession(self) -> Succession | None:
        """Whose place it takes; None: it is the mission with which its team was started."""
        found = (feature.succession(section) for feature, section in used(self.sections))
        return next((each for each in found if each is not None), None)

    @property
    def team_digest(self) -> str:
        """The digest that the messages of its team name."""
        return self.digest if self.succession is None else self.succession.team

    @cached_property
    def number(self) -> int:
        """0: the mission with which the team was started."""
        return self.succession.number if self.succession is not None else 0

    @cached_property
    def robot_ids(self) -> frozenset[RobotId]:
        """The robots that the mission names."""
        return frozenset(self.robots)

    @cached_property
    def local_task_types(self) -> Mapping[LocalTaskId, str]:
        """The type of each ground local task that global tasks need."""
        needs = (need for task in self.all_tasks() for need in task.needs)
        return {need.local_task: type_name(need.local_task) for need in needs}

    def all_tasks(self) -> Iterator[GlobalTask]:
        """The global tasks, and those of job types with placeholders in their names."""
        yield from self.global_tasks.values()
        for known in self.jobs.values():
            yield from known.global_tasks.values()

    @cached_property
    def most_demands(self) -> int:
        """How many local tasks may be asked for at the same time, by jobs as well."""
        tasks, nodes = {task.id: task for task in self.all_tasks()}, self.tree.nodes

        def needs(index: int) -> int:
            node = nodes[index]
            if node.kind is Kind.ACTION:
                return len(tasks[node.subject].needs)
            return sum(map(needs, node.children)) * (node.limit if node.kind is Kind.JOBS else 1)

        return needs(0)

    @cached_property
    def may_need_arrays(self) -> bool:
        """Whether assignments may get so large that arrays are faster. Robots that join without
        being named here do not change it.
        """
        return needs_arrays(len(self.robots), self.most_demands)

    @cached_property
    def limits(self) -> Limits | None:
        """What limits which robots may work together; None: nothing does."""
        found = (feature.limits(section) for feature, section in used(self.sections))
        return next((each for each in found if each is not None), None)

    @cached_property
    def plan_steps(self) -> tuple[PlanStep, ...]:
        """What features do in the plans of this mission, in their order."""
        found = (feature.plan_step(self) for feature in features())
        return tuple(each for each in found if each is not None)

    @cached_property
    def stops_in_time(self) -> bool:
        """Whether others count on it that robots stop in time by their own clocks."""
        of_features = any(
            feature.stops_in_time(section) for feature, section in used(self.sections)
        )
        return of_features or self.has_tasks_at_most_once

    @cached_property
    def has_tasks_at_most_once(self) -> bool:
        """Whether any task is done at most once."""
        return any(task.at_most_once for task in self.all_tasks())

    @cached_property
    def has_paper_policy(self) -> bool:
        """Whether any task fails by the paper's count."""
        return any(task.failure is FailurePolicy.PAPER for task in self.all_tasks())

    @cached_property
    def entries(self) -> MissionEntries:
        """What names of conditions mean."""
        given = self.conditions, tuple(sorted(self.robots)), self.evaluator
        found = (feature.entries(*given) for feature in features())
        return next((each for each in found if each is not None), None) or MissionEntries(*given)

    @cached_property
    def truths(self) -> dict[str, ConditionType]:
        """The declared conditions alone, which are true or false."""
        return {name: known for name, known in self.conditions.items() if known.is_truth}

    def is_failure_reason(self, ground: str) -> bool:
        """Whether a condition follows from failure reasons, so that programs do not set it."""
        known = self.conditions.get(type_name(ground))
        return known is not None and known.failure is not None

    def conditions_after_end(
        self, global_task: GlobalTaskId, local_task: LocalTaskId, success: bool, reason: str
    ) -> list[tuple[str, bool]]:
        """The values that an outcome gives to the conditions that follow from failure reasons."""
        ends = (
            known.after_end(global_task, local_task, success, reason)
            for known in self._failure_conditions
        )
        return [end for end in ends if end is not None]

    @cached_property
    def _failure_conditions(self) -> list[ConditionType]:
        return [self.conditions[n] for n in sorted(self.conditions) if self.is_failure_reason(n)]

    def nominal_work(self, ground: LocalTaskId) -> int:
        """The nominal work of a local task in micro-units."""
        known = self.local_tasks.get(type_name(ground))
        return known.work if known is not None else MICRO

    def declared_work(self, ground: LocalTaskId) -> int | None:
        """The same; None where the mission does not say, or says what it is anyway."""
        work = self.nominal_work(ground)
        return None if work == MICRO else work

    def to_json(self) -> dict[str, Any]:
        """The compiled mission as plain data; `mission_from_json` takes it back."""
        data: dict[str, Any] = _CODEC.write(Mission, self)
        return data | {"compiled": COMPILED_VERSION}


def mission_from_json(data: Mapping[str, Any]) -> Mission:
    """Load a compiled mission, as `mrbt validate --compile` and `mrbt up` write it.

    Raises ValueError if it was not compiled by this version, or was damaged.
    """
    found = data.get("compiled")
    if type(found) is not int or found != COMPILED_VERSION:
        raise ValueError(f"compiled mission version {COMPILED_VERSION} expected, found {found!r}")
    try:
        fields = {name: value for name, value in data.items() if name != "compiled"}
        mission: Mission = _CODEC.read(Mission, fields)
        tree = mission.tree
        for feature, section in used(mission.sections):
            tree = feature.numbered(section, tree)
    except ValueError as error:
        raise ValueError(f"compiled mission is damaged: {error}") from None
    return replace(mission, tree=tree)


_CODEC = Codec(
    {
        Tree: StandIn(NodeSpec, Tree.spec, build_tree),
        Mapping[str, ProgramTree]: StandIn(SharedTrees, shared_trees, SharedTrees.trees_by_task),
    },
    classes_of,
)
