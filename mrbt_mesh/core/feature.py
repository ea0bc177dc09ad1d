"""What a feature of missions may add to the kernel, and the features that there are.

The kernel (trees, facts, members, planning, assignment, the agent) knows no feature. It loops over
`features()` and calls what each of them offers. A feature is a package of `mrbt_mesh.features`,
whose `FEATURE` is an instance of `Feature`; CONTRIBUTING.md tells how to write one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

    from mrbt_mesh.core.agent.context import Context
    from mrbt_mesh.core.agent.effects import StartAction
    from mrbt_mesh.core.agent.health import Health
    from mrbt_mesh.core.agent.inputs import ActionFinished, FeatureInput
    from mrbt_mesh.core.agent.operator_desk import FieldRule
    from mrbt_mesh.core.agent.planner import Planner
    from mrbt_mesh.core.agent.start_policy import StartPolicy
    from mrbt_mesh.core.assignment.problem import SideConstraint
    from mrbt_mesh.core.bt.activation import ActivationNames
    from mrbt_mesh.core.bt.evaluation import Request as TreeRequest
    from mrbt_mesh.core.bt.tree import Tree
    from mrbt_mesh.core.facts.records import Claim, Job, Record
    from mrbt_mesh.core.facts.store import Entry, Fact, Incarnation, Version
    from mrbt_mesh.core.facts.task_status import TeamMembers
    from mrbt_mesh.core.facts.team_facts import TeamFacts
    from mrbt_mesh.core.membership.wire import Heartbeat, Request, RequestAnswer
    from mrbt_mesh.core.mission.conditions import ConditionType
    from mrbt_mesh.core.mission.mission import GlobalTask, JobType, Mission, MissionEntries
    from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
    from mrbt_mesh.core.planning.consistency import LimitCheck
    from mrbt_mesh.core.planning.demands import Demand, Group
    from mrbt_mesh.core.planning.plan import PendingLoss, Plan, RobotAssignment, Waiting
    from mrbt_mesh.formats.mission_model import GlobalTaskModel, MissionModel, NeedModel
    from mrbt_mesh.formats.problems import Report, SourcePath
    from mrbt_mesh.observer.feature_history import FeatureHistory
    from mrbt_mesh.sim.chaos.feature_chaos import FeatureChaos
    from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker
    from mrbt_mesh.sim.checkers.findings import RunFindings

# The packages of the features, in the order in which the kernel calls them.
NAMES: tuple[str, ...] = ("revisions", "contact", "constraints", "bids", "exclusive", "values")


class CommandField(NamedTuple):
    """A field that operators command: a replicated fact, of which the newest value counts.

    `read`: raises ValueError for what is no value. `parts`: of how many parts the names of such
    facts consist, the field itself included. `is_of_robot`: the second part is a robot's id.
    `is_of_activation`: it is an activation of an action, and the fact is dropped with it. `once`:
    the field is commanded only once, so the first value counts. `is_shown`: timelines show it.
    """

    read: Callable[[Any], Any]
    parts: int
    is_of_robot: bool = False
    is_of_activation: bool = False
    once: bool = False
    is_shown: bool = True


class Index:
    """What a feature reads from the facts of one run of one mission."""

    def add(self, entry: Entry) -> None:
        """Take in an entry of one of the feature's kinds; it replaces the one of the same name."""

    def remove(self, entry: Entry) -> None:
        """An entry is dropped, with all others of its activation if it is of one."""

    def obsolete(self) -> Sequence[tuple[str, str]]:
        """(author, name) of the entries of no activation that nothing reads any more."""
        return ()

    def successor(self) -> Mission | None:
        """The mission that the facts put in force in the place of the present one; None: none."""
        return None

    def says(self, entry: Entry) -> bool:
        """Whether a fact that follows from others (`Feature.derived`) adds nothing to the facts."""
        return False

    def shows(self, entry: Entry, alive: Mapping[str, Incarnation]) -> bool:
        """Whether such a fact follows from the facts. `alive`: the robots that one counts on."""
        return False

    def objects_to_job(self, job: Job) -> str:
        """Why no operator may submit this job now; empty: the feature does not mind."""
        return ""

    def idle(self, reasons: Mapping[str, str]) -> Mapping[str, str]:
        """Why a plan assigns nothing to some of these robots, where the feature knows it better.

        `reasons`: robot -> the reason that the planner gives.
        """
        return {}


class Succession(ABC):
    """How a mission takes the place of others of its team while the team runs.

    `number`: how many missions the team had before. `team`: the digest of the first one, which the
    team's messages name.
    """

    number: int
    team: str

    @abstractmethod
    def keeps_number(self, number: int) -> bool:
        """Whether a node of an earlier tree may come back under this number, or is yet to come."""


class PerformanceRule(ABC):
    """From what the performances for a need follow, where they are not as declared."""

    @abstractmethod
    def problem(self) -> str:
        """What is wrong with it in a compiled mission, if that was damaged; empty: nothing."""


class JointPolicy(ABC):
    """How the robots of a global task carry it out jointly, as parties; see `JointFacts`.

    `at_most_once`: no two parties are at work at the same time, and none begins what another one
    may have done. `why_unscheduled`: why no schedule has such a task, empty if they may.
    """

    @property
    @abstractmethod
    def at_most_once(self) -> bool: ...

    @property
    @abstractmethod
    def why_unscheduled(self) -> str: ...

    @abstractmethod
    def problem(self) -> str:
        """What is wrong with it in a compiled mission, if that was damaged; empty: nothing."""

    @abstractmethod
    def demands(
        self,
        facts: TeamFacts,
        request: TreeRequest,
        capabilities: Capabilities,
        able: Sequence[Mapping[str, int]],
        asked: str,
    ) -> Group:
        """The demands of a request, in the task's order of needs. `able`: for each need, robot ->
        performance. `asked`: what else holds for these robots, as a text.
        """

    @abstractmethod
    def obstacle(
        self, facts: TeamFacts, request: TreeRequest, group: Group, team: Mapping[str, Worker]
    ) -> str:
        """Why a request cannot be served, whichever robots are free; empty if it can."""

    @abstractmethod
    def lead(
        self,
        facts: TeamFacts,
        task: GlobalTask,
        activation: str,
        alive: Mapping[str, Incarnation],
    ) -> tuple[str, int]:
        """The leader of the party at work, empty if none is; and how many have ended before."""

    @abstractmethod
    def latches(
        self,
        facts: TeamFacts,
        task: GlobalTask,
        activation: str,
        alive: Mapping[str, Incarnation],
        me: str,
    ) -> list[Fact]:
        """The facts to write, with a plan, about the parties to an activation."""


class JointFacts(ABC):
    """The parties to one activation: robots that carry it out jointly, so that only outcomes of the
    same party count together. An outcome names its party, and is kept here.
    """

    @abstractmethod
    def add(self, entry: Entry) -> None:
        """Take in an entry of one of the feature's kinds."""

    @abstractmethod
    def stamp_of(self, entry: Entry) -> int:
        """The Lamport stamp in the name of such an entry."""

    @abstractmethod
    def add_outcome(
        self, party: str, local_task: str, robot: str, success: bool, version: Version
    ) -> None:
        """Take in the outcome of a member of a party."""

    @property
    @abstractmethod
    def has_outcome(self) -> bool:
        """Whether some robot has an outcome."""

    @property
    @abstractmethod
    def has_success(self) -> bool:
        """Whether some robot has succeeded."""

    @property
    @abstractmethod
    def verdict(self) -> bool | None:
        """Success or failure, as an operator has decided; None: nobody has."""

    @abstractmethod
    def has_succeeded(self, task: GlobalTask) -> bool:
        """Whether the task has succeeded, by an operator's decision or by its outcomes."""

    @abstractmethod
    def has_failed(self, task: GlobalTask, team: TeamMembers) -> bool:
        """Whether the task has failed, by an operator's decision or by its outcomes."""

    @abstractmethod
    def results(self, local_task: str, team: TeamMembers) -> Mapping[str, bool]:
        """Robot -> success, for the outcomes of one local task that count now."""

    @abstractmethod
    def may_be_done(self) -> bool:
        """Whether a task that is done at most once is done, may be done, or is in doubt."""


class Kit(NamedTuple):
    """The kernel's parts of an agent that a feature's part may use.

    `report`: write how an action has ended, at this time. `given_up`: the facts to write when a
    claim is dropped without an outcome.
    """

    context: Context
    health: Health
    planner: Planner
    report: Callable[[ActionFinished, int], None]
    given_up: Callable[[Claim], list[Fact]]


class Part:
    """What a feature adds to one agent. Every method may be left as it is here."""

    # -- what comes in ------------------------------------------------------------------------

    def handlers(self) -> Mapping[type[FeatureInput], Callable[[Any, int], object]]:
        """Inputs of the feature -> what takes them, with the time in us."""
        return {}

    def words(self) -> Mapping[str, Callable[[str, int], tuple[bool, str]]]:
        """Words of operators to this robot -> what carries them out: with the argument and the time
        in us; it returns whether it did, and a text.
        """
        return {}

    def longest(self) -> Mapping[str, int]:
        """Words whose arguments may be longer than usual -> how many characters they may have."""
        return {}

    def rules(self) -> Mapping[str, FieldRule]:
        """How this robot takes the commands of the feature's fields."""
        return {}

    def heard(self, robot: str, beat: Heartbeat, now_us: int) -> None:
        """Another robot's heartbeat has come."""

    def finished(self, event: ActionFinished, now_us: int) -> bool:
        """Whether the part keeps the end of an action back; it calls `Kit.report` later."""
        return False

    def synced(self) -> None:
        """The journal has more on the disk."""

    # -- what goes out ------------------------------------------------------------------------

    def request(self) -> Request | None:
        """What this robot's heartbeats request of others; at most one part requests anything."""
        return None

    def answers(self) -> Sequence[RequestAnswer]:
        """The answers to requests of others that its heartbeats carry."""
        return ()

    def sent(self, number: int, now_us: int) -> None:
        """This robot sends a heartbeat of this number, before its request and answers are read."""

    # -- its life -----------------------------------------------------------------------------

    def resume(self, now_us: int) -> None:
        """This robot continues a recorded incarnation."""

    def first_life(self) -> None:
        """This robot joins, and no robot of the mission knows an earlier life of it."""

    def is_bound(self) -> bool:
        """Whether this robot has promised something, or was promised something that it needs: it
        must not be absent, nor wait for a plan that is made elsewhere, nor skip a step.
        """
        return False

    # -- a step -------------------------------------------------------------------------------

    def agree(self, now_us: int) -> None:
        """Agree with the other robots on the mission in force, at the beginning of a step. It is
        called again once another mission was taken up; not while this robot joins.
        """

    def taken_up(self, mission: Mission) -> None:
        """Another mission is in force, and this robot follows it from now on."""

    def check(self, now_us: int) -> bool:
        """Do what is due now; returns whether the agent has to follow a change of facts."""
        return False

    def follow(self, now_us: int) -> None:
        """Act on the facts, before a plan is made."""

    def may_begin(self, claim: Claim, now_us: int) -> bool:
        """Whether this robot may begin what it claims, as far as the feature is concerned."""
        return True

    def start_policy(self, task: GlobalTask) -> StartPolicy | None:
        """What else a robot waits for before it begins this task; None: this part has no say."""
        return None

    def started(self, action: StartAction, now_us: int) -> None:
        """This robot has begun an action, or set out for its place."""

    def settle(self, now_us: int) -> None:
        """Write what the facts ask for, as the last thing before a plan is made."""

    def prepare(self, plan: Plan, now_us: int) -> None:
        """Do what a new plan asks for before anybody acts by it."""

    def perform(self, plan: Plan, now_us: int) -> None:
        """Act by the plan, after this robot's assignment was followed."""

    def next_us(self, now_us: int) -> int | None:
        """When `check` or `may_begin` is to be called again at the latest."""
        return None

    def steps_until_us(self) -> int | None:
        """Until when the program may go on without further news; None: there is no limit."""
        return None

    def end(self, now_us: int) -> None:
        """Another mission is in force, and this part is not used for it."""


class Limits(ABC):
    """What limits which robots may work together, in the plans of one mission.

    `name`: what such limits are called, after "its" or "the mission has".
    """

    name: ClassVar[str]

    @abstractmethod
    def side_constraints(
        self, free: Sequence[str], wanted: Sequence[Demand], running: Mapping[str, Demand]
    ) -> tuple[SideConstraint, ...]:
        """What is left to `free` robots on the `wanted` demands, both by index.

        `running` maps robots to the demands that they work on. What cannot bind is left out.
        """

    @abstractmethod
    def check(self, robots: Sequence[str], demands: Sequence[Sequence[Demand]]) -> LimitCheck:
        """What decides which of the requests with these demands can be kept."""


class PlanPart(ABC):
    """What a feature adds to one plan, for those who act by it and for people.

    `name`: what it is called in a plan as plain data, as the feature's `in_plan`.
    """

    name: ClassVar[str]

    @abstractmethod
    def to_json(self) -> Sequence[Any]:
        """Plain data."""

    def deadlines(self, detection_us: int) -> Mapping[str, int]:
        """Facts that are latched once all plans have shown this for so long: name -> time in us.

        `detection_us`: the detection time of the team.
        """
        return {}

    def performance_text(self, assignment: RobotAssignment) -> str:
        """What to tell people in the place of the performance of an assignment; empty: nothing."""
        return ""


class Offer:
    """What a feature makes of the demands of one plan.

    `groups`: the demands that the plan is to meet, by request. `part`: what the plan shows of it.
    """

    awaited_things: ClassVar[str] = ""

    def __init__(self, groups: Sequence[Group], part: PlanPart | None = None) -> None:
        self.groups = groups
        self.part = part

    def postponed(
        self, kept: Sequence[int], assignments: Mapping[str, RobotAssignment]
    ) -> Mapping[int, tuple[str, ...]]:
        """The requests that get nobody yet, of those that are kept -> the robots of which something
        is awaited first, which is called `awaited_things`.
        """
        return {}


class PlanStep:
    """What a feature does in the plans of one mission. Every method may be left as it is here."""

    def eligible(self, facts: TeamFacts, request: TreeRequest) -> Sequence[str] | None:
        """The robots that a request is for, dead ones included; None: it is for all."""
        return None

    def asked_for(self, facts: TeamFacts, request: TreeRequest) -> str:
        """What `eligible` goes by, for people, with a blank before it; empty if it is for all."""
        return ""

    def offer(self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]) -> Offer:
        """What it makes of the demands of one plan."""
        return Offer(groups)

    def losses(self, facts: TeamFacts, team: Collection[str]) -> Sequence[PendingLoss]:
        """What robots outside the team had and others have to get again."""
        return ()

    def why_unscheduled(self, task: GlobalTask) -> str:
        """Why no schedule has such a task; empty: the feature does not mind."""
        return ""


class Built(NamedTuple):
    """What is made of a mission file before its features have their turn.

    `robot_types`: type -> what its robots can do, in micro-units. `local_tasks`: type ->
    parameters. `global_tasks`: the ground ones of the tree. `jobs`: types by name.
    """

    robot_types: Mapping[str, Mapping[str, int]]
    local_tasks: Mapping[str, Sequence[str]]
    global_tasks: Collection[str]
    jobs: Mapping[str, JobType]


class Feature:
    """One feature. Every method may be left as it is here.

    `section`: the name of what a mission has of it, if it has anything.
    `commands`: the fields that operators command for it. `kinds`: kinds of facts about activations
    of global tasks, which are dropped with them -> of how many parts their names consist: kind,
    activation, and so on. `team_kinds`: the same of other kinds; `derived`: those that follow from
    other facts, so that one robot's word is not enough. `in_any_mission`: the kinds, commands
    included, that have a place whichever mission of the team is in force. `in_plan`: the name of
    what a plan has of it, if it has anything. `has_joint_facts`: its facts about activations,
    commands included, are kept in a `JointFacts` for each activation; one feature at most has such.
    """

    section: ClassVar[str] = ""
    commands: ClassVar[Mapping[str, CommandField]] = {}
    kinds: ClassVar[Mapping[str, int]] = {}
    team_kinds: ClassVar[Mapping[str, int]] = {}
    derived: ClassVar[Collection[str]] = ()
    in_any_mission: ClassVar[Collection[str]] = ()
    in_plan: ClassVar[str] = ""
    has_joint_facts: ClassVar[bool] = False

    def activation_kinds(self) -> Sequence[str]:
        """The kinds of its facts about activations, commands included."""
        fields = (field for field, known in self.commands.items() if known.is_of_activation)
        return (*self.kinds, *fields)

    def other_kinds(self) -> Sequence[str]:
        """The kinds of its facts that are about no activation, commands included."""
        fields = (field for field, known in self.commands.items() if not known.is_of_activation)
        return (*self.team_kinds, *fields)

    # -- the mission --------------------------------------------------------------------------

    def section_type(self) -> Any:
        """The type of its section of a mission, of which `core.codec` makes plain data."""
        raise NotImplementedError

    def mission_classes(self) -> Sequence[type]:
        """Its kinds of `PerformanceRule`, `JointPolicy` and `EntryTraits`, as dataclasses."""
        return ()

    def problem(self, section: Any, mission: Mission) -> str | None:
        """What is wrong with a section of a compiled mission, if it was damaged."""
        return None

    def succession(self, section: Any) -> Succession | None:
        """How the mission takes the place of others; one feature at most knows it."""
        return None

    def numbered(self, section: Any, tree: Tree) -> Tree:
        """The tree of a compiled mission with the numbers of its nodes, by which facts name them.
        Raises ValueError.
        """
        return tree

    def stops_in_time(self, section: Any) -> bool:
        """Whether others count on it that robots stop in time by their own clocks."""
        return False

    def limits(self, section: Any) -> Limits | None:
        """What limits which robots a plan may have work together; one feature at most has any."""
        return None

    def entries(
        self, declared: Mapping[str, ConditionType], robots: Sequence[str], names: ActivationNames
    ) -> MissionEntries | None:
        """What names of conditions mean in a mission that declares these, `robots` sorted; None: as
        usual. One feature at most has any.
        """
        return None

    # -- the mission file ---------------------------------------------------------------------

    def file_fields(self) -> Mapping[str, Mapping[str, tuple[Any, FieldInfo]]]:
        """Fields of a mission file, by the model of `formats.mission_model` that gets them, each
        with its type and `FieldInfo`, as `pydantic.create_model` takes them.
        """
        return {}

    def build(self, model: MissionModel, built: Built, report: Report) -> Any:
        """The section of a mission from its file; problems go to the report. Empty: it has none."""
        return None

    def performance_rule(
        self, need: NeedModel, local_task: str, path: SourcePath, report: Report
    ) -> PerformanceRule | None:
        """The `Need.performance_rule` for this local task, None if the feature has none; problems
        go to the report. `local_task`: empty while it is not known which one it is.
        """
        return None

    def build_joint(
        self, task: GlobalTaskModel, path: SourcePath, report: Report
    ) -> JointPolicy | None:
        """How a global task of a mission file is carried out jointly; None: not by this feature."""
        return None

    # -- facts, plans and agents --------------------------------------------------------------

    def parse(self, kind: str, value: Any) -> Record:
        """The record of a fact of one of the feature's kinds. Raises ValueError for any other."""
        raise NotImplementedError

    def malformed(self, entry: Entry) -> str:
        """What is wrong in any mission with the name of a fact of the feature, or of an outcome
        that names a party; empty: nothing.
        """
        return ""

    def misplaced(self, entry: Entry, mission: Mission) -> str:
        """Why a team with this mission has no place for a fact of the feature that is about no
        activation; empty: it has.
        """
        return ""

    def refuses(self, entry: Entry, task: GlobalTask) -> str:
        """Why an activation of this task has no place for a fact of the feature; empty: it has."""
        return ""

    def objects_to_repeat(self, step: str) -> str:
        """Why no revision is taken up that begins this step anew, which is done at most once and
        was begun, with the remedy; empty: it is not for this feature to say.
        """
        return ""

    def joint_facts(self) -> JointFacts:
        """A new index for the facts of one activation, if the feature `has_joint_facts`."""
        raise NotImplementedError

    def index(self, mission: Mission) -> Index | None:
        """A new index for the facts of a run of this mission."""
        return None

    def plan_step(self, mission: Mission) -> PlanStep | None:
        """What the feature does in the plans of this mission; None: nothing."""
        return None

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        """The parts of an agent for the mission in force, in the order of their calls.

        `before`: those for the mission before it; those that are not returned are ended.
        """
        return ()

    # -- the observer -------------------------------------------------------------------------

    def history(self, limit: int | None) -> FeatureHistory | None:
        """What is kept of a run for its summary, at most `limit` rows; None: nothing."""
        return None

    def warnings(self, facts: TeamFacts, robots: Collection[str]) -> Iterator[str]:
        """What the headline of a team warns of. `robots`: those that are members."""
        yield from ()

    def would_help(
        self, facts: TeamFacts, waiting: Waiting, here: Collection[str]
    ) -> tuple[Collection[str], int]:
        """Which robots could end what keeps a request from being served, if they were started, and
        how many of them it takes. `here`: the robots that are members.
        """
        return (), 0

    # -- the simulator ------------------------------------------------------------------------

    def chaos(self, seed: int) -> FeatureChaos | None:
        """How random missions and scenarios use the feature."""
        return None

    def allows(self, section: Any, doers: Mapping[str, str]) -> bool:
        """Whether these robots may carry out these local tasks, of one global task, while nobody
        else is at work. For checkers, which try every assignment.
        """
        return True

    def awaits_operator(self, facts: TeamFacts, request: TreeRequest) -> bool:
        """Whether a request may wait for an operator though robots could serve it. For checkers."""
        return False

    def checkers(self, run: RunFindings) -> Sequence[FeatureChecker]:
        """Checkers of the invariants that the feature promises."""
        return ()


@cache
def features() -> tuple[Feature, ...]:
    """All features, in the order of `NAMES`."""
    return tuple(import_module(f"mrbt_mesh.features.{name}").FEATURE for name in NAMES)


def used(sections: Mapping[str, Any]) -> Iterator[tuple[Feature, Any]]:
    """The features that have a section there, each with its section."""
    for feature in features():
        if feature.section in sections:
            yield feature, sections[feature.section]


def overrides(made: object, base: type, name: str) -> bool:
    """Whether an object has a method of its own in the place of that of a base class."""
    return getattr(type(made), name) is not getattr(base, name)


def section_type(name: str) -> Any:
    """The type of a section of missions; None: no feature has a section of this name."""
    found = (each.section_type() for each in features() if name and each.section == name)
    return next(found, None)


@cache
def classes_of(base: type) -> tuple[type, ...]:
    """The dataclasses that features have of a base class in missions."""
    found = (kind for feature in features() for kind in feature.mission_classes())
    return tuple(kind for kind in found if issubclass(kind, base))
