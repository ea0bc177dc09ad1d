"""The drill file as pydantic models: what happens when, and what must hold at the end.

If the validation's context is a `DrillReport`, names of robots, tasks and conditions are checked
against its mission.
"""

from __future__ import annotations

import string
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, Discriminator, Field, Tag, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MAX_ROBOTS, MICRO, Mission
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.drills.beside import words
from mrbt_mesh.errors import nearest
from mrbt_mesh.features.exclusive.kinds import Decision
from mrbt_mesh.formats.file_model import (
    EXPLAINED,
    FileModel,
    GroundText,
    Name,
    RobotName,
    by_type,
    one_of,
)
from mrbt_mesh.formats.problems import Report
from mrbt_mesh.observer.task_log import TaskState

MAX_SECONDS = 3_600.0
MAX_STEPS, MAX_BESIDE = 1_000, 9
DONE = "done"

_DRILL = r"^[A-Za-z0-9_]{1,64}$"
DRILL_EXPLAINED = EXPLAINED | {
    _DRILL: "the name of a drill is expected: 1 to 64 letters, digits or _",
}


def _is_command(text: object) -> bool:
    try:
        return isinstance(text, str) and bool(words(text))
    except ValueError:
        return False


@dataclass
class DrillReport(Report):
    """The problems of a drill file, and the mission whose names it may use."""

    mission: Mission | None = None


def _local_tasks(mission: Mission) -> set[str]:
    """Return the ground local tasks that the mission needs, and their types."""
    ground = {need.local_task for task in mission.all_tasks() for need in task.needs}
    return ground | {split_call(name)[0] for name in ground}


def _known(kind: str, names: Callable[[Mission], Collection[str]]) -> AfterValidator:
    """Return a validator for a name that the mission must have."""

    def check(name: str, info: ValidationInfo) -> str:
        mission = info.context.mission if isinstance(info.context, DrillReport) else None
        if mission is not None and name not in names(mission):
            # An instance of a parametrised condition has the condition's name.
            if kind == "condition" and mission.entries.is_condition(name):
                return name
            text = f"no {kind} {name!r} in this mission{nearest(name, names(mission))}"
            raise PydanticCustomError("node", "{text}", {"text": text})
        return name

    return AfterValidator(check)


Robot: TypeAlias = Annotated[RobotName, _known("robot", lambda m: m.robots)]
GlobalTask: TypeAlias = Annotated[GroundText, _known("global task", lambda m: m.global_tasks)]
LocalTask: TypeAlias = Annotated[GroundText, _known("local task", _local_tasks)]
AnyTask: TypeAlias = Annotated[
    GroundText, _known("task", lambda m: {*m.global_tasks, *_local_tasks(m)})
]
Capability: TypeAlias = Annotated[
    GroundText, _known("local task", lambda m: {"all", *_local_tasks(m)})
]
Condition: TypeAlias = Annotated[GroundText, _known("condition", lambda m: m.truths)]
Seconds: TypeAlias = Annotated[float, Field(ge=0, le=MAX_SECONDS)]
Permille: TypeAlias = Annotated[int, Field(ge=1, le=1_000)]
Count: TypeAlias = Annotated[int, Field(ge=0, le=MAX_ROBOTS)]
RouterNumber: TypeAlias = Annotated[int, Field(ge=1, le=9)]
Profile: TypeAlias = Literal["wired", "wireless"]
Command: TypeAlias = Annotated[str, one_of("a command, e.g. python world.py", _is_command)]
Yes: TypeAlias = Annotated[Literal[True], one_of("true", lambda v: v is True)]

_PHASES = (*(phase.name.lower() for phase in Phase), DONE)
_STATUSES = tuple(map(str, TaskState))


def _in(names: tuple[str, ...]) -> Any:
    return Annotated[str, one_of(f"one of {', '.join(names)}", lambda v: v in names)]


def _only_one_key(data: Any, what: str, known: list[str]) -> None:
    if isinstance(data, dict) and sum(key in known for key in data) != 1:
        listed = ", ".join(known)
        raise PydanticCustomError(
            "node", "{text}", {"text": f"{what} has exactly one of the keys {listed}"}
        )


class _Words(string.Formatter):
    """Fills in the sentences of triggers and faults."""

    def format_field(self, value: Any, spec: str) -> str:
        match value:
            case None:
                return "any robot"
            case bool():
                return str(value).lower()
            case list():
                within = " | " if any(isinstance(each, list) for each in value) else ", "
                return within.join(self.format_field(each, "") for each in value)
        return format(value, spec)


class RoleModel(FileModel):
    """Robots by what they do or what befell them: `{performing: fix_hw(2)}`, `{replacement}`.

    performing: those that run a global or local task now, or if none does, are about to.
    replacement: the one that took over last. killed, stopped, left: those that this has been
    done to, and not undone. thawed: those that were stopped and go on.
    """

    performing: Annotated[AnyTask | None, Field(title="the robots that perform {}")] = None
    replacement: Annotated[None, Field(title="the replacement")] = None
    killed: Annotated[None, Field(title="the killed robots")] = None
    stopped: Annotated[None, Field(title="the frozen robots")] = None
    thawed: Annotated[None, Field(title="the thawed robots")] = None
    left: Annotated[None, Field(title="the robots that have left")] = None

    @model_validator(mode="before")
    @classmethod
    def _one_role(cls, data: Any) -> Any:
        _only_one_key(data, "a role", cls.known_keys())
        return data

    @property
    def role(self) -> str:
        """The role's key in the file."""
        (name,) = self.model_fields_set
        return name

    def __str__(self) -> str:
        title = type(self).model_fields[self.role].title
        return str(title).format(self.performing)


Robots: TypeAlias = Annotated[
    Annotated[Robot, Tag("<text>")]
    | Annotated[list[Robot], Field(min_length=1), Tag("<list>")]
    | Annotated[RoleModel, Tag("<mapping>")],
    by_type(
        "a robot, a list of robots, or a role, e.g. {performing: fix_hw(2)}",
        {str: "<text>", list: "<list>", dict: "<mapping>"},
    ),
]


# -- when ---------------------------------------------------------------------------------


class GlobalTaskTrigger(FileModel):
    """A global task has come to a status: idle, running, success, failure, cancelled."""

    SENTENCE: ClassVar = "{0.global_task} is {0.status}"
    global_task: GlobalTask
    status: _in(_STATUSES) = "running"  # type: ignore[valid-type]


class LocalTaskTrigger(FileModel):
    """A robot (or any) has claimed a local task, or runs it, or has done it."""

    SENTENCE: ClassVar = "{0.robot} has {0.local_task} {0.phase}"
    local_task: LocalTask
    robot: Robot | None = None
    phase: _in(_PHASES) = "running"  # type: ignore[valid-type]


class RobotTrigger(FileModel):
    """Robots are seen in a state by the drill's observer."""

    SENTENCE: ClassVar = "{0.robot} is {0.state}"
    robot: Robots
    state: Literal["alive", "suspect", "dead", "left"]


class ConditionTrigger(FileModel):
    """A condition has a value."""

    SENTENCE: ClassVar = "{0.condition} is {0.value}"
    condition: Condition
    value: Annotated[bool, Field(alias="is")] = True


class TakeoverTrigger(FileModel):
    """Since the step before, a robot has taken over this local task of a dead one."""

    SENTENCE: ClassVar = "a robot has taken {0.takeover} over"
    takeover: LocalTask


class BlockedTrigger(FileModel):
    """A global task is blocked; `reason`: and this is part of the reason, e.g. in doubt."""

    SENTENCE: ClassVar = "{0.blocked} is blocked"
    blocked: GlobalTask
    reason: str = ""


_TRIGGERS = ("global_task", "local_task", "robot", "condition", "takeover", "blocked")


def _trigger_tag(value: Any) -> str | None:
    if not isinstance(value, dict):
        return None
    # {local_task: ..., robot: ...} is about the local task.
    return next((f"<{key}>" for key in _TRIGGERS if key in value), None)


When: TypeAlias = Annotated[
    Annotated[GlobalTaskTrigger, Tag("<global_task>")]
    | Annotated[LocalTaskTrigger, Tag("<local_task>")]
    | Annotated[RobotTrigger, Tag("<robot>")]
    | Annotated[ConditionTrigger, Tag("<condition>")]
    | Annotated[TakeoverTrigger, Tag("<takeover>")]
    | Annotated[BlockedTrigger, Tag("<blocked>")],
    Discriminator(
        _trigger_tag,
        custom_error_type="shape",
        custom_error_message=f"a trigger with one of {', '.join(_TRIGGERS)}",
    ),
]


# -- what ---------------------------------------------------------------------------------


class CapabilityModel(FileModel):
    """Robots and a capability: a local task, ground or a type, or `all`."""

    robots: Robots
    local_task: Capability = "all"


class PerformanceModel(FileModel):
    """Robots, a local task, ground or a type, and how well they do it from now on."""

    robots: Robots
    local_task: LocalTask
    performance: Annotated[float, Field(ge=0, le=MAX_PERFORMANCE // MICRO)]


class DecisionModel(FileModel):
    """The operator's decision on an exclusive task that is in doubt."""

    global_task: GlobalTask
    decision: _in(tuple(Decision))  # type: ignore[valid-type]


class LinksModel(FileModel):
    """Links in one direction; from or to every robot by default."""

    source: Annotated[Robots | None, Field(alias="from")] = None
    target: Annotated[Robots | None, Field(alias="to")] = None


class LossModel(LinksModel):
    """Independent loss of packets, in thousandths, on links in one direction."""

    permille: Permille

    @property
    def percent(self) -> float:
        """The loss in percent."""
        return self.permille / 10


class DelayModel(LinksModel):
    """A delay on links in one direction, in ms."""

    ms: Annotated[int, Field(ge=1, le=60_000)]


def _fault(sentence: str, key: str | None = None) -> Any:
    """Declare a fault of a step, with its sentence.

    `key` is its key in the file if that is a keyword.
    """
    return Field(None, description=sentence, alias=key)


class StepModel(FileModel):
    """Faults, and the moment: `at` (s from the start of the run), `when`, `after` (s).

    `after` counts from the trigger, or without one from the step before. Steps are
    carried out one after the other, in the order of the list. A task that the next step waits to
    see running does not end before that step, nor does one that it names as `performing` without
    a trigger: the simulated robots of `agents/` hold it, so that no step comes too late.
    """

    at: Seconds | None = None
    when: When | None = None
    after: Seconds | None = None
    kill: Robots | None = _fault("kill {0}")
    stop: Robots | None = _fault("freeze {0}")
    continue_: Robots | None = _fault("thaw {0}", "continue")
    leave: Robots | None = _fault("have {0} leave")
    restart: Robots | None = _fault("start {0} again")
    join: Robots | None = _fault("start {0}")
    kill_team: Yes | None = _fault("kill all robots")
    resume_team: Yes | None = _fault("start all robots again")
    lose_capability: CapabilityModel | None = _fault("have {0.robots} lose {0.local_task}")
    restore_capability: CapabilityModel | None = _fault("give {0.local_task} back to {0.robots}")
    change_performance: PerformanceModel | None = _fault(
        "have {0.robots} do {0.local_task} at {0.performance:g}"
    )
    decide: DecisionModel | None = _fault("decide that {0.global_task} counts as {0.decision}")
    partition: Annotated[list[Robots], Field(min_length=1)] | None = _fault("cut the team into {0}")
    block: LinksModel | None = _fault("block the links from {0.source} to {0.target}")
    unblock: LinksModel | None = _fault("unblock the links from {0.source} to {0.target}")
    lose: LossModel | None = _fault(
        "lose {0.percent:g} % of the messages from {0.source} to {0.target}"
    )
    delay: DelayModel | None = _fault("delay messages from {0.source} to {0.target} by {0.ms} ms")
    heal: Yes | None = _fault("heal the network")
    kill_router: RouterNumber | None = _fault("kill router {0}")
    stop_router: RouterNumber | None = _fault("freeze router {0}")
    restart_router: RouterNumber | None = _fault("start router {0} again")

    @model_validator(mode="after")
    def _has_moment_and_fault(self) -> StepModel:
        moment = {"at", "when", "after"} & self.model_fields_set
        if not moment or ("at" in moment and len(moment) > 1):
            text = "a step needs at, or when (with or without after), or after"
            raise PydanticCustomError("node", "{text}", {"text": text})
        if not self.faults():
            known = [key for key in self.known_keys() if key not in ("at", "when", "after")]
            text = f"a step needs at least one of {', '.join(known)}"
            raise PydanticCustomError("node", "{text}", {"text": text})
        return self

    def faults(self) -> list[tuple[str, Any]]:
        """Return (key in the file, its value) of each fault, in the order of this model."""
        return [
            (field.alias or name, getattr(self, name))
            for name, field in type(self).model_fields.items()
            if field.description is not None and getattr(self, name) is not None
        ]

    def robots(self) -> list[Robots]:
        """Return the robots named by the faults, unless a fault means all of them."""
        found: list[Robots | None] = []
        for name, fault in self.faults():
            match fault:
                case LinksModel():
                    found += [fault.source, fault.target]
                case CapabilityModel() | PerformanceModel():
                    found.append(fault.robots)
                case list() if name == "partition":
                    found += fault
                case str() | list() | RoleModel():
                    found.append(fault)
        return [robots for robots in found if robots is not None]

    def text(self) -> str:
        """Return the step as text: `when replace_hw(2) is running, after 0.2 s: freeze A1`."""
        words, moments = _Words(), []
        if self.at is not None:
            moments.append(f"{self.at:g} s after the start")
        if self.when is not None:
            moments.append("when " + words.format(self.when.SENTENCE, self.when))
        if self.after is not None:
            moments.append(f"after {self.after:g} s")
        faults = (
            words.format(field.description or "", getattr(self, name))
            for name, field in type(self).model_fields.items()
            if field.description is not None and getattr(self, name) is not None
        )
        return f"{', '.join(moments)}: {' and '.join(faults)}"


ROUTER_FAULTS = frozenset({"kill_router", "stop_router", "restart_router"})
NETWORK_FAULTS = frozenset({"partition", "block", "unblock", "lose", "delay", "heal"})


class CycleModel(FileModel):
    """Steps that are carried out several times in a row."""

    cycles: Annotated[int, Field(ge=1, le=MAX_STEPS)]
    steps: Annotated[list[StepModel], Field(min_length=1, max_length=MAX_STEPS)]


def _step_tag(value: Any) -> str | None:
    if not isinstance(value, dict):
        return None
    return "<cycle>" if "cycles" in value or "steps" in value else "<step>"


StepOrCycle: TypeAlias = Annotated[
    Annotated[StepModel, Tag("<step>")] | Annotated[CycleModel, Tag("<cycle>")],
    Discriminator(
        _step_tag,
        custom_error_type="shape",
        custom_error_message="a step, e.g. {at: 3.5, kill: A1}, or {cycles: 3, steps: [...]}",
    ),
]


# -- what must hold -----------------------------------------------------------------------


class DoneModel(FileModel):
    """How often a local task was done (its action ended in success, all robots counted).

    A type means each of its ground tasks that was started, of which there must be one.
    `times` is both bounds at once.
    """

    local_task: LocalTask
    global_task: GlobalTask | None = None
    times: Count | None = None
    at_least: Count | None = None
    at_most: Count | None = None

    @model_validator(mode="after")
    def _has_bounds(self) -> DoneModel:
        bounds = {"times", "at_least", "at_most"} & self.model_fields_set
        if not bounds or ("times" in bounds and len(bounds) > 1):
            text = "times, or at_least and at_most, or one of them is expected"
            raise PydanticCustomError("node", "{text}", {"text": text})
        return self

    @property
    def bounds(self) -> tuple[int, int | None]:
        """The least and the most times; None: no limit."""
        if self.times is not None:
            return self.times, self.times
        return self.at_least or 0, self.at_most


class NeverModel(FileModel):
    """No more than this many robots perform a local task at the same time, at any time.

    A type means each of its ground tasks. `overlap_s`: so long they may overlap all the same, since
    what is cancelled goes on to its next `await`.
    """

    local_task: LocalTask
    more_than: Count = 1
    overlap_s: Seconds = 0.0


class ExpectModel(FileModel):
    """What must hold at the end. Beside it, all steps must have been carried out.

    `links_back_within_s`: every link that fell silent is heard again so soon after the heal
    before. `stalls`: the most links that fall silent though no step disturbed them. `checks`:
    commands that end with 0 when the team has ended, before what is beside it does.
    """

    result: Literal["success", "failure", "blocked"] = "success"
    done: list[DoneModel] = []
    never: list[NeverModel] = []
    dead: Robots | None = None
    alive: Robots | None = None
    left: Robots | None = None
    yields: Robots | None = None
    was_blocked: list[GlobalTask] = []
    detected_within_s: Seconds | None = None
    takeover_within_s: Seconds | None = None
    repeated: Count | None = None
    false_deaths: Count | None = None
    links_back_within_s: Seconds | None = None
    stalls: Count | None = None
    checks: list[Command] = []


class TimingModel(FileModel):
    """Heartbeat period and detection time, in s, as `mrbt up` has them."""

    beat_s: Annotated[float, Field(gt=0, le=60)] = 0.2
    detection_s: Annotated[float, Field(gt=0, le=600)] = 1.0


Profiles: TypeAlias = Annotated[
    Annotated[Profile, Tag("<text>")]
    | Annotated[list[Profile], Field(min_length=1, max_length=2), Tag("<list>")],
    by_type("wired, wireless, or both as a list", {str: "<text>", list: "<list>"}),
]


class DrillModel(FileModel):
    """A mission, faults with their moments, and what must hold at the end.

    `for_each` makes one drill per combination of its values; `$name` is replaced by a value.
    `quick`: part of the short set. `routers`: their number; they are numbered from 1 on, and all
    robots are clients, which try the first one first. `beside`: commands that run beside the team
    from before its start until after its end, in the drill file's folder.
    """

    name: Annotated[str, Field(pattern=_DRILL)]
    description: str = ""
    quick: bool = False
    mission: str
    for_each: dict[Name, list[Any]] = {}
    robots: Annotated[list[Robot], Field(min_length=1)] | None = None
    speed: Annotated[float, Field(gt=0, le=1_000)] = 1.0
    timing: TimingModel = TimingModel()
    timeout_s: Annotated[float, Field(gt=0, le=MAX_SECONDS)] = 120.0
    transport: Profiles = "wired"
    network: Literal["loopback", "namespaces"] = "loopback"
    routers: Annotated[int, Field(ge=0, le=9)] = 0
    beside: Annotated[list[Command], Field(max_length=MAX_BESIDE)] = []
    steps: Annotated[list[StepOrCycle], Field(max_length=MAX_STEPS)] = []
    expect: ExpectModel = ExpectModel()

    @property
    def profiles(self) -> list[Profile]:
        """The transport profiles; the drill is run once with each."""
        return [self.transport] if isinstance(self.transport, str) else list(self.transport)

    def unrolled(self) -> list[StepModel]:
        """Return the steps, with cycles unrolled."""
        found: list[StepModel] = []
        for item in self.steps:
            if isinstance(item, CycleModel):
                found += item.steps * item.cycles
            else:
                found.append(item)
        return found
