"""The mission file as pydantic models: shapes, types and ranges, and the JSON Schema.

What needs more than one place of the file (is this task declared, do the arguments fit)
is checked in `expand` and `build`.

Write the schema anew with `python -m mrbt_mesh.formats.mission_model`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    ConfigDict,
    Field,
    JsonValue,
    Tag,
    ValidationError,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from mrbt_mesh.core.bt.tree import MAX_NODES, Kind
from mrbt_mesh.core.mission.mission import (
    MAX_ARGUMENTS,
    MAX_BID_WITHIN_US,
    MAX_COST,
    MAX_GLOBAL_TASKS,
    MAX_ROBOTS,
    MICRO,
    NAME_PATTERN,
)
from mrbt_mesh.formats.file_model import (
    CALL_HINT,
    EXPLAINED,
    FileModel,
    GroundText,
    Name,
    RobotName,
    by_type,
    call_pattern,
    explain,
    one_of,
    place_of,
)
from mrbt_mesh.formats.problems import Report, found, nearest

MAX_PERFORMANCE_UNITS = 1e6
MAX_WORK = 1e9
MAX_SECONDS = 1e9
MAX_CONSTRAINTS = 100
SCHEMA_FILE = Path(__file__).with_name("mission.schema.json")

_CALL = call_pattern(r"\s*[A-Za-z0-9_.+$-]{1,64}\s*")
_REFERENCE = rf"^\${NAME_PATTERN}$"
_PROGRAM = r"^[^\n]+\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"
_SOLVER = r"^[A-Za-z_][A-Za-z0-9_.-]{0,127}(:[A-Za-z_][A-Za-z0-9_.]{0,127})?$"
_TITLE = r"^[^/\n]{1,64}$"

EXPLAINED_HERE = EXPLAINED | {
    _CALL: f"{CALL_HINT}, e.g. fix_hw or fix_hw($part)",
    _REFERENCE: "a list or the name of a parameter is expected, e.g. [1, 2] or $parts",
    _PROGRAM: "a Python file is expected, e.g. robot.py or robot.py:name",
    _SOLVER: "the name of a solver is expected, e.g. cp_sat or package.module:function",
    _TITLE: "1 to 64 characters without / are expected",
}

CallText: TypeAlias = Annotated[str, Field(pattern=_CALL)]
ProgramText: TypeAlias = Annotated[str, Field(pattern=_PROGRAM)]
SolverText: TypeAlias = Annotated[str, Field(pattern=_SOLVER)]
Title: TypeAlias = Annotated[str, Field(pattern=_TITLE)]
Parameters: TypeAlias = Annotated[list[Name], Field(max_length=MAX_ARGUMENTS)]
Performance: TypeAlias = Annotated[float, Field(gt=0, le=MAX_PERFORMANCE_UNITS)]
Count: TypeAlias = Annotated[int, Field(ge=1, le=MAX_ROBOTS)]
Cost: TypeAlias = Annotated[int, Field(ge=0, le=MAX_COST)]


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


Scalar: TypeAlias = Annotated[
    str | int | float | bool,
    one_of("text, a number, true or false", lambda v: isinstance(v, str | int | float)),
    WithJsonSchema({"type": ["string", "number", "boolean"]}),
]
Success: TypeAlias = Annotated[
    Literal["all", "any"] | int,
    one_of("all, any, or a number from 1", lambda v: v in ("all", "any") or _at_least(v, 1)),
    WithJsonSchema({"anyOf": [{"enum": ["all", "any"]}, {"type": "integer", "minimum": 1}]}),
]
Tries: TypeAlias = Annotated[
    int,
    one_of("a number from 1, or -1 for no limit", lambda v: _at_least(v, 1) or _is_minus_one(v)),
    WithJsonSchema({"anyOf": [{"const": -1}, {"type": "integer", "minimum": 1}]}),
]


def _at_least(value: Any, least: int) -> bool:
    return _is_integer(value) and least <= value <= 1_000_000_000


def _is_minus_one(value: Any) -> bool:
    return _is_integer(value) and value == -1


class LocalTaskModel(FileModel):
    """A local-task type; a robot with performance p needs work / p seconds for it.

    `cost`: what it costs to make one more robot capable of it, for `mrbt analyze`.
    """

    parameters: Parameters = []
    work: Annotated[float, Field(gt=0, le=MAX_WORK)] = 1.0
    cost: Cost = 1


class ConditionModel(FileModel):
    """A condition; while nobody has set it, it reads as `default`."""

    parameters: Parameters = []
    default: bool = False


class RobotTypeModel(FileModel):
    """A kind of robot: what it can do, and how well.

    `cost`: what one more robot costs, for `mrbt analyze`.
    """

    capabilities: dict[GroundText, Performance]
    cost: Cost = 1


class RobotModel(FileModel):
    """A robot that differs from its type; null takes a capability away."""

    type: Name
    capabilities: dict[GroundText, Performance | None] = {}


class SameRobotModel(FileModel):
    """A local task of another global task; without `local_task`, the only one that it needs."""

    global_task: CallText
    local_task: CallText | None = None


class BidModel(FileModel):
    """Bids that are waited for this many seconds."""

    bid_within_s: Annotated[float, Field(gt=0, le=MAX_BID_WITHIN_US / MICRO)]


class NeedModel(FileModel):
    """How many robots a local task needs (`min`, nu) and can use (`max`, mu; default `min`).

    `same_robot_as`: only robots that have succeeded with that before.
    `performance: bid`: how well a robot does it is known only to the robot, which bids for it.
    """

    min: Count = 1
    max: Count | None = None
    same_robot_as: SameRobotModel | None = None
    performance: Annotated[
        Annotated[Literal["declared", "bid"], Tag("<text>")]
        | Annotated[BidModel, Tag("<mapping>")],
        by_type("declared, bid, or {bid_within_s: 0.5}", {str: "<text>", dict: "<mapping>"}),
    ] = "declared"


class FailAfterModel(FileModel):
    """A global task that fails after it was blocked for this many seconds."""

    fail_after_s: Annotated[float, Field(gt=0, le=MAX_SECONDS)]


class GlobalTaskModel(FileModel):
    """A task of the whole team: the local tasks that it needs, and its policies.

    `simultaneous`: its robots start together. `exclusive`: never done twice; what became of a
    robot that vanished in the middle is `in_doubt`, to be held for the operator (hold), counted
    as failed (fail) or tried again (retry).
    """

    parameters: Parameters = []
    needs: Annotated[dict[CallText, NeedModel], Field(min_length=1)]
    failure: Literal["resilient", "paper"] = "resilient"
    blocked: Annotated[
        Annotated[Literal["wait"], Tag("<text>")] | Annotated[FailAfterModel, Tag("<mapping>")],
        by_type("wait, or {fail_after_s: 20}", {str: "<text>", dict: "<mapping>"}),
    ] = "wait"
    preemptive: bool = False
    simultaneous: bool = False
    exclusive: bool = False
    in_doubt: Literal["hold", "fail", "retry"] | None = None

    @model_validator(mode="after")
    def _in_doubt_with_exclusive(self) -> GlobalTaskModel:
        if self.in_doubt is not None and not self.exclusive:
            raise PydanticCustomError(
                "in_doubt", "in_doubt is for exclusive tasks; add exclusive: true or remove it"
            )
        return self


Node: TypeAlias = Annotated[
    Annotated[CallText, Tag("<text>")] | Annotated["NodeModel", Tag("<mapping>")],
    by_type(
        "a node, e.g. {Sequence: [...]} or an action's name", {str: "<text>", dict: "<mapping>"}
    ),
]
Nodes: TypeAlias = Annotated[
    Annotated[CallText, Tag("<text>")]
    | Annotated["NodeModel", Tag("<mapping>")]
    | Annotated[list[Node], Tag("<list>")],
    by_type("a node or a list of nodes", {str: "<text>", dict: "<mapping>", list: "<list>"}),
]
ForEach: TypeAlias = Annotated[
    Annotated[str, Field(pattern=_REFERENCE), Tag("<text>")]
    | Annotated[list[Scalar], Tag("<list>")],
    by_type(EXPLAINED_HERE[_REFERENCE], {str: "<text>", list: "<list>"}),
]


class CompositeModel(FileModel):
    """The children of a Sequence or Fallback: a list, and one `do` for each of some values.

    `memory: while_running`: a child that has ended is not looked at again before the node ends,
    as in BehaviorTree.CPP's Sequence. `until_success`: as in its SequenceWithMemory.
    """

    name: Title | None = None
    memory: Literal["none", "while_running", "until_success"] = "none"
    children: Annotated[list[Node], Field(max_length=MAX_NODES)] = []
    for_each: Annotated[dict[Name, ForEach], Field(min_length=1)] | None = None
    do: Nodes | None = None

    @model_validator(mode="after")
    def _for_each_with_do(self) -> CompositeModel:
        if (self.for_each is None) != (self.do is None):
            raise PydanticCustomError("children", "for_each and do belong together; one is missing")
        if not self.children and self.do is None:
            raise PydanticCustomError("children", "children, or for_each and do, are missing")
        return self


class ParallelModel(CompositeModel):
    """A Parallel, which succeeds once `success` of its children have (the paper's M).

    It fails when that is out of reach, and if `failures` is given, at that many failures already.
    """

    success: Success = "all"
    failures: Annotated[int, Field(ge=1, le=MAX_NODES)] | None = None


class RetryModel(FileModel):
    """Tries again until success; `attempts: -1` tries for ever."""

    name: Title | None = None
    attempts: Tries
    do: Node


class RepeatModel(FileModel):
    """Repeats while it succeeds; `cycles: -1` repeats for ever."""

    name: Title | None = None
    cycles: Tries
    do: Node


class TimeoutModel(FileModel):
    """Fails what takes longer than `seconds`."""

    name: Title | None = None
    seconds: Annotated[float, Field(gt=0, le=MAX_SECONDS)]
    do: Node


_LIST_OR_MAPPING = by_type(
    "a list of nodes, or a mapping with children, or for_each and do",
    {list: "<list>", dict: "<mapping>"},
)
CompositeBody: TypeAlias = Annotated[
    Annotated[list[Node], Field(min_length=1), Tag("<list>")]
    | Annotated[CompositeModel, Tag("<mapping>")],
    _LIST_OR_MAPPING,
]
ParallelBody: TypeAlias = Annotated[
    Annotated[list[Node], Field(min_length=1), Tag("<list>")]
    | Annotated[ParallelModel, Tag("<mapping>")],
    _LIST_OR_MAPPING,
]


def _kind(kind: Kind) -> Any:
    return Field(default=None, alias=str(kind))


class NodeModel(FileModel):
    """A node of a tree: a mapping with exactly one key, the type of the node."""

    model_config = ConfigDict(json_schema_extra=lambda schema: _exactly_one_key(schema))

    sequence: CompositeBody = _kind(Kind.SEQUENCE)
    fallback: CompositeBody = _kind(Kind.FALLBACK)
    parallel: ParallelBody = _kind(Kind.PARALLEL)
    if_then_else: CompositeBody = _kind(Kind.IF_THEN_ELSE)
    action: CallText = _kind(Kind.ACTION)
    condition: CallText = _kind(Kind.CONDITION)
    inverter: Node = _kind(Kind.INVERTER)
    force_success: Node = _kind(Kind.FORCE_SUCCESS)
    force_failure: Node = _kind(Kind.FORCE_FAILURE)
    retry: RetryModel = _kind(Kind.RETRY)
    repeat: RepeatModel = _kind(Kind.REPEAT)
    timeout: TimeoutModel = _kind(Kind.TIMEOUT)
    keep_running: Node = _kind(Kind.KEEP_RUNNING_UNTIL_FAILURE)
    subtree: CallText = _kind(Kind.SUBTREE)

    @model_validator(mode="before")
    @classmethod
    def _one_known_key(cls, data: Any) -> Any:
        if isinstance(data, dict):
            unknown = [key for key in data if key not in cls.known_keys()]
            if len(data) != 1:
                keys = ", ".join(str(key) for key in list(data)[:5]) or "none"
                hint = "; text with commas needs quotes" if unknown else ""
                text = f"a node has exactly one key, its type, found {keys}{hint}"
                raise PydanticCustomError("node", "{text}", {"text": text})
            if unknown:
                text = f"unknown type of node {unknown[0]!r}{nearest(unknown[0], cls.known_keys())}"
                raise PydanticCustomError("node", "{text}", {"text": text})
        return data

    def kind_and_body(self) -> tuple[Kind, Any]:
        """The type of the node and what stands under it."""
        (name,) = self.model_fields_set
        return Kind(str(type(self).model_fields[name].alias)), getattr(self, name)


def _exactly_one_key(schema: dict[str, Any]) -> None:
    schema["minProperties"] = schema["maxProperties"] = 1
    for kind in schema["properties"].values():
        kind.pop("default", None)


class SubTreeModel(FileModel):
    """A part of a tree that can be used many times, with arguments."""

    parameters: Parameters = []
    tree: Node


RobotEntry: TypeAlias = Annotated[
    Annotated[Name, Tag("<text>")] | Annotated[RobotModel, Tag("<mapping>")],
    by_type(
        "a robot type, or {type: ..., capabilities: {...}}", {str: "<text>", dict: "<mapping>"}
    ),
]


class NeverTogetherModel(FileModel):
    """At most one of these robots on the same demand; of `local_tasks` only, if there are any."""

    robots: Annotated[list[RobotName], Field(min_length=2)]
    local_tasks: list[GroundText] = []


class AtMostModel(FileModel):
    """At most `count` of these robots at work at the same time."""

    robots: Annotated[list[RobotName], Field(min_length=2)]
    count: Count = 1


class NotAtOnceModel(FileModel):
    """At most `count` requests for these global tasks served at the same time.

    A type stands for all its tasks.
    """

    global_tasks: Annotated[list[GroundText], Field(min_length=1)]
    count: Count = 1


class ConstraintsModel(FileModel):
    """Who may not work together, or at the same time; see docs/solvers.md."""

    never_together: Annotated[list[NeverTogetherModel], Field(max_length=MAX_CONSTRAINTS)] = []
    at_most: Annotated[list[AtMostModel], Field(max_length=MAX_CONSTRAINTS)] = []
    not_at_once: Annotated[list[NotAtOnceModel], Field(max_length=MAX_CONSTRAINTS)] = []


class MissionModel(FileModel):
    """A mission of a team of robots.

    `assignment: spare_scarce`: where robots may break at work, those that others can replace go
    first, even if something has to wait for them. `solver`: what solves the assignment problem,
    `constraints`: what else it has to mind (docs/solvers.md).
    """

    mission: Name
    program: ProgramText | None = None
    assignment: Literal["any", "spare_scarce"] = "any"
    solver: SolverText | None = None
    constraints: ConstraintsModel = ConstraintsModel()
    parameters: dict[Name, JsonValue] = {}
    local_tasks: dict[Name, LocalTaskModel]
    conditions: dict[Name, ConditionModel] = {}
    robot_types: dict[Name, RobotTypeModel]
    robots: Annotated[dict[RobotName, RobotEntry], Field(min_length=1, max_length=MAX_ROBOTS)]
    global_tasks: Annotated[dict[Name, GlobalTaskModel], Field(max_length=MAX_GLOBAL_TASKS)] = {}
    subtrees: dict[Name, SubTreeModel] = {}
    tree: Node


_STAND_INS: dict[str, Any] = {
    "int_type": 1,
    "float_type": 1,
    "greater_than": 1,
    "greater_than_equal": 1,
    "less_than_equal": 1,
    "bool_type": False,
}


def validate(data: Any, report: Report) -> MissionModel | None:
    """Check the shape of the file; problems go to the report. None if it cannot be used."""
    if not isinstance(data, dict):
        report.add((), f"a mission is expected (mission: ..., robots: ...), found {found(data)}")
        return None
    for _ in range(2):
        try:
            return MissionModel.model_validate(data, context=report)
        except ValidationError as error:
            details = error.errors(include_url=False)
        for detail in details:
            report.add(*explain(detail, EXPLAINED_HERE))
        if not all(detail["type"] in _STAND_INS for detail in details):
            return None
        # Wrong values, but the right shape: with others in their place, more can be checked.
        _replace_wrong_values(data, details)
    return None


def _replace_wrong_values(data: dict[str, Any], details: list[ErrorDetails]) -> None:
    for detail in details:
        *parents, last = place_of(detail)
        container: Any = data
        for part in parents:
            container = container[part]
        container[last] = _STAND_INS[detail["type"]]


def schema_text() -> str:
    """The JSON Schema of mission files, as it is committed in `mission.schema.json`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schema |= MissionModel.model_json_schema(by_alias=True)
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    SCHEMA_FILE.write_text(schema_text(), encoding="utf-8")
    sys.stdout.write(f"written: {SCHEMA_FILE}\n")
