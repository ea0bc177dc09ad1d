"""The drill file as pydantic models: what happens when, and what must hold at the end.

What needs the mission (are there such robots and tasks) is checked in `drill_file`.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from mrbt_mesh.core.agent.commands import Decision
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MAX_ROBOTS, MICRO
from mrbt_mesh.core.observer.task_log import TaskState
from mrbt_mesh.drills.beside import words
from mrbt_mesh.formats.file_model import (
    EXPLAINED,
    FileModel,
    GroundText,
    Name,
    RobotName,
    by_type,
    one_of,
)

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


class RoleModel(FileModel):
    """Robots by what they do or what befell them: `{performing: fix_hw(2)}`, `{replacement}`.

    performing: those that run a global or local task now, or if nobody does, are about to.
    replacement: the one that took over last. killed, stopped, left: those that this has been
    done to, and not undone. thawed: those that were stopped and go on.
    """

    performing: GroundText | None = None
    replacement: None = None
    killed: None = None
    stopped: None = None
    thawed: None = None
    left: None = None

    @model_validator(mode="before")
    @classmethod
    def _one_role(cls, data: Any) -> Any:
        _only_one_key(data, "a role", cls.known_keys())
        return data

    @property
    def role(self) -> str:
        """The key that stands in the file."""
        (name,) = self.model_fields_set
        return name


Robots: TypeAlias = Annotated[
    Annotated[RobotName, Tag("<text>")]
    | Annotated[list[RobotName], Field(min_length=1), Tag("<list>")]
    | Annotated[RoleModel, Tag("<mapping>")],
    by_type(
        "a robot, a list of robots, or a role, e.g. {performing: fix_hw(2)}",
        {str: "<text>", list: "<list>", dict: "<mapping>"},
    ),
]


# -- when ---------------------------------------------------------------------------------


class GlobalTaskTrigger(FileModel):
    """A global task has come to a status: idle, running, success, failure, cancelled."""

    global_task: GroundText
    status: _in(_STATUSES) = "running"  # type: ignore[valid-type]


class LocalTaskTrigger(FileModel):
    """A robot (or any) has claimed a local task, or runs it, or has done it."""

    local_task: GroundText
    robot: RobotName | None = None
    phase: _in(_PHASES) = "running"  # type: ignore[valid-type]


class RobotTrigger(FileModel):
    """Robots are seen in a state by the drill's observer."""

    robot: Robots
    state: Literal["alive", "suspect", "dead", "left"]


class ConditionTrigger(FileModel):
    """A condition has a value."""

    condition: GroundText
    value: Annotated[bool, Field(alias="is")] = True


class TakeoverTrigger(FileModel):
    """Since the step before, somebody has taken over this local task of a dead robot."""

    takeover: GroundText


class BlockedTrigger(FileModel):
    """A global task is blocked; `reason`: and this is part of the reason, e.g. in doubt."""

    blocked: GroundText
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
    local_task: GroundText = "all"


class PerformanceModel(FileModel):
    """Robots, a local task, ground or a type, and how well they do it from now on."""

    robots: Robots
    local_task: GroundText
    performance: Annotated[float, Field(ge=0, le=MAX_PERFORMANCE // MICRO)]


class DecisionModel(FileModel):
    """The operator's word on an exclusive task that is in doubt."""

    global_task: GroundText
    decision: _in(tuple(Decision))  # type: ignore[valid-type]


class LinksModel(FileModel):
    """Links in one direction; from or to everybody where nothing is said."""

    source: Annotated[Robots | None, Field(alias="from")] = None
    target: Annotated[Robots | None, Field(alias="to")] = None


class LossModel(LinksModel):
    """Independent loss of packets, in thousandths, on links in one direction."""

    permille: Permille


class DelayModel(LinksModel):
    """A delay on links in one direction, in ms."""

    ms: Annotated[int, Field(ge=1, le=60_000)]


class StepModel(FileModel):
    """Faults, and the moment: `at` (s from the start of the run), `when`, `after` (s).

    `after` counts from the trigger, or, where it stands alone, from the step before. Steps are
    carried out one after the other, in the order of the list. A task that the next step waits to
    see running does not end before that step, nor does one that it names as `performing` without
    a trigger: the simulated robots of `agents/` hold it, so that no step comes too late.
    """

    at: Seconds | None = None
    when: When | None = None
    after: Seconds | None = None
    kill: Robots | None = None
    stop: Robots | None = None
    continue_: Annotated[Robots | None, Field(alias="continue")] = None
    leave: Robots | None = None
    restart: Robots | None = None
    join: Robots | None = None
    kill_team: Yes | None = None
    resume_team: Yes | None = None
    lose_capability: CapabilityModel | None = None
    restore_capability: CapabilityModel | None = None
    change_performance: PerformanceModel | None = None
    decide: DecisionModel | None = None
    partition: Annotated[list[Robots], Field(min_length=1)] | None = None
    block: LinksModel | None = None
    unblock: LinksModel | None = None
    lose: LossModel | None = None
    delay: DelayModel | None = None
    heal: Yes | None = None
    kill_router: RouterNumber | None = None
    stop_router: RouterNumber | None = None
    restart_router: RouterNumber | None = None

    @model_validator(mode="after")
    def _has_moment_and_fault(self) -> StepModel:
        moment = {"at", "when", "after"} & self.model_fields_set
        if not moment or ("at" in moment and len(moment) > 1):
            text = "a step needs at, or when (with or without after), or after"
            raise PydanticCustomError("node", "{text}", {"text": text})
        if not self.faults():
            known = [n for n in self.known_keys() if n not in ("at", "when", "after")]
            text = f"a step needs at least one of {', '.join(known)}"
            raise PydanticCustomError("node", "{text}", {"text": text})
        return self

    def faults(self) -> list[tuple[str, Any]]:
        """(key in the file, what stands there), in the order of this model."""
        moments = ("at", "when", "after")
        return [
            (field.alias or name, getattr(self, name))
            for name, field in type(self).model_fields.items()
            if name not in moments and getattr(self, name) is not None
        ]


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

    A type stands for each of its ground tasks that was started, of which there must be one.
    `times` is both bounds at once.
    """

    local_task: GroundText
    global_task: GroundText | None = None
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
        """(least, most); None: no limit."""
        if self.times is not None:
            return self.times, self.times
        return self.at_least or 0, self.at_most


class NeverModel(FileModel):
    """No more than this many robots perform a local task at the same time, at any time.

    A type stands for each of its ground tasks.
    """

    local_task: GroundText
    more_than: Count = 1


class ExpectModel(FileModel):
    """What must hold at the end. Beside it, all steps must have been carried out.

    `links_back_within_s`: every link that fell silent is heard again so soon after the heal
    before. `stalls`: at most so many links fall silent that no step has disturbed. `checks`:
    commands that end with 0 when the team has ended, before what is beside it does.
    """

    result: Literal["success", "failure", "blocked"] = "success"
    done: list[DoneModel] = []
    never: list[NeverModel] = []
    dead: Robots | None = None
    alive: Robots | None = None
    left: Robots | None = None
    yields: Robots | None = None
    was_blocked: list[GroundText] = []
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

    `for_each` makes one drill per combination of its values; `$name` stands for a value.
    `quick`: part of the short set. `routers`: so many, numbered from 1 on, of which all robots are
    clients; they try the first one first. `beside`: commands that run beside the team from before
    its start until after its end, in the drill file's folder.
    """

    name: Annotated[str, Field(pattern=_DRILL)]
    description: str = ""
    quick: bool = False
    mission: str
    for_each: dict[Name, list[Any]] = {}
    robots: Annotated[list[RobotName], Field(min_length=1)] | None = None
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
        """The transport profiles: the drill is run once with each."""
        return [self.transport] if isinstance(self.transport, str) else list(self.transport)

    def unrolled(self) -> list[StepModel]:
        """The steps, cycles written out."""
        found: list[StepModel] = []
        for item in self.steps:
            if isinstance(item, CycleModel):
                found += item.steps * item.cycles
            else:
                found.append(item)
        return found
