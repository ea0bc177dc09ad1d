"""The mission file as pydantic models: shapes, types and ranges, and the JSON Schema.

What needs more than one place of the file (is this task declared, do the arguments fit) is checked
in `expand` and `build`.

Update the schema with `python -m mrbt_mesh.formats.mission_model`.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, TypeVar

from pydantic import (
    BeforeValidator,
    Field,
    JsonValue,
    Tag,
    ValidationError,
    create_model,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.conditions import MAX_DECIMALS, MAX_TEXT
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.core.mission.mission import (
    MAX_CHOICES,
    MAX_COST,
    MAX_GLOBAL_TASKS,
    MAX_JOB_TYPES,
    MAX_NUMBER,
    MAX_PRIORITY,
    MAX_ROBOTS,
)
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_ARGUMENTS, NAME_PATTERN
from mrbt_mesh.core.mission.travel import MAX_HORIZON, MAX_MS, MAX_OVERTAKING, MAX_PLACES
from mrbt_mesh.formats.file_model import (
    Count,
    FileModel,
    GroundText,
    Name,
    RobotName,
    by_type,
    explain,
    place_of,
)
from mrbt_mesh.formats.indentation import indentation_hint
from mrbt_mesh.formats.problems import Report, found
from mrbt_mesh.formats.tree_model import (
    MAX_SECONDS,
    TREE_EXPLAINED,
    CallText,
    Node,
    NodeModel,
    Scalar,
    Tries,
)

MAX_PERFORMANCE_UNITS = 1e6
MAX_WORK = 1e9
MAX_COORDINATE = 1e9
SCHEMA_FILE = Path(__file__).with_name("mission.schema.json")

_PROGRAM = r"^[^\n]+\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"
_SOLVER = r"^[A-Za-z_][A-Za-z0-9_.-]{0,127}(:[A-Za-z_][A-Za-z0-9_.]{0,127})?$"
_PLACE = f"^{ARGUMENT_PATTERN}$"
_LIST = rf"^\${NAME_PATTERN}$"
_PLACE_OR_LIST = rf"^(place|\${NAME_PATTERN})$"
_AT = rf"^([A-Za-z0-9_.+-]|\${NAME_PATTERN}){{1,64}}$"

_TREE_FILE = r"^[^\n#]+\.xml(#[^\n#]+)?$"
_IN_A_FILE = "write a BehaviorTree.CPP file and name it, e.g. tree: fetch.xml#Fetch"

EXPLAINED_HERE = TREE_EXPLAINED | {
    _TREE_FILE: "a BehaviorTree.CPP file is expected, e.g. fetch.xml#Fetch",
    _PROGRAM: "a Python file is expected, e.g. robot.py or robot.py:name",
    _PLACE: "a place is expected: 1 to 64 letters, digits, _, ., + or -",
    _AT: "a place is expected, e.g. dock, $place or shelf_$number",
    _PLACE_OR_LIST: "place, or the name of a parameter that is a list, is expected, e.g. $shelves",
    _SOLVER: "the name of a solver is expected, e.g. cp_sat or package.module:function",
}

TreeFile: TypeAlias = Annotated[
    str, Field(pattern=_TREE_FILE), BeforeValidator(lambda value: _refuse_nodes(value))
]
ProgramText: TypeAlias = Annotated[str, Field(pattern=_PROGRAM)]
SolverText: TypeAlias = Annotated[str, Field(pattern=_SOLVER)]
ReasonText: TypeAlias = Annotated[str, Field(min_length=1, max_length=MAX_REASON)]
Parameters: TypeAlias = Annotated[list[Name], Field(max_length=MAX_ARGUMENTS)]
Performance: TypeAlias = Annotated[float, Field(gt=0, le=MAX_PERFORMANCE_UNITS)]
Per: TypeAlias = Literal["team", "robot"]
Cost: TypeAlias = Annotated[int, Field(ge=0, le=MAX_COST)]
Place: TypeAlias = Annotated[str, Field(pattern=_PLACE)]
PlaceText: TypeAlias = Annotated[str, Field(pattern=_AT)]
Coordinate: TypeAlias = Annotated[float, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Point: TypeAlias = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Number: TypeAlias = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Way: TypeAlias = Annotated[float, Field(ge=0, le=MAX_MS / 1_000)]

_Model = TypeVar("_Model", bound=FileModel)


def _refuse_nodes(value: Any) -> Any:
    """Refuse a robot's tree in the mission file itself, as earlier versions allowed."""
    if isinstance(value, dict):
        raise PydanticCustomError("node", f"a robot's tree is not written in YAML: {_IN_A_FILE}")
    return value


def with_features(model: type[_Model]) -> type[_Model]:
    """Return the model with the fields that features add."""
    added = [each.file_fields().get(model.__name__, {}) for each in features()]
    fields: dict[str, Any] = {name: kind for each in added for name, kind in each.items()}
    if not fields:
        return model
    return create_model(model.__name__, __base__=model, __doc__=model.__doc__, **fields)


@with_features
class LocalTaskModel(FileModel):
    """A local-task type; a robot with performance p needs work / p seconds for it.

    `effects`: conditions that its action sets when it succeeds; robots' programs set them, checks
    read them here. `sets`: blackboard entries that it sets, likewise. `cost`: what it costs to make
    one more robot capable of it, for `mrbt analyze`.
    `at`: the place of `travel` where it happens, or a parameter that names it; else anywhere.
    """

    parameters: Parameters = []
    work: Annotated[float, Field(gt=0, le=MAX_WORK)] = 1.0
    at: PlaceText | None = None
    effects: dict[CallText, bool] = {}
    sets: list[Name] = []
    cost: Cost = 1


class LocalTaskOrTreeModel(LocalTaskModel):
    """A local-task type that may be a tree.

    `tree`: `FILE.xml#TreeID`, a BehaviorTree.CPP tree, relative to the mission file, which each
    robot runs for itself (docs/how-to/robot-trees.md): the robot's program has its leaves; `ports`
    are its entries at first, `outputs` the conditions and entries of the team's blackboard that its
    entries set when it has ended.
    """

    tree: TreeFile | None = None
    ports: dict[str, Scalar] = {}
    outputs: dict[str, CallText] = {}

    @model_validator(mode="after")
    def _ports_of_a_file(self) -> LocalTaskOrTreeModel:
        if self.tree is None and (self.ports or self.outputs):
            raise PydanticCustomError(
                "ports", "ports and outputs are those of a tree in a file: tree: FILE.xml#TreeID"
            )
        return self


class FailureReasonModel(FileModel):
    """A failure of one task, with a reason that equals a text or contains it."""

    global_task: CallText | None = None
    local_task: CallText | None = None
    equals: ReasonText | None = None
    contains: ReasonText | None = None

    @model_validator(mode="after")
    def _one_of_each(self) -> FailureReasonModel:
        for one, other in (("global_task", "local_task"), ("equals", "contains")):
            if (getattr(self, one) is None) is (getattr(self, other) is None):
                context = {"one": one, "other": other}
                raise PydanticCustomError(
                    "failure_reason", "failure_reason takes either {one} or {other}", context
                )
        return self


class ConditionModel(FileModel):
    """A condition; until it is set, it reads as `default`.

    `per: robot`: every robot has its own, and the tree reads whether it holds for any of them.
    `failure_reason`: it is true while the last outcome of a task is a failure with such a reason.
    """

    parameters: Parameters = []
    default: bool = False
    per: Per = "team"
    failure_reason: FailureReasonModel | None = None


class EntryModel(FileModel):
    """An entry of the team's blackboard; until it is set it has its `default`, if it has one.

    It holds one of `values`; or a number from `min` to `max`, with at most `decimals` decimals; or
    a text of at most `text` characters: letters, digits, _, ., + and -. `per: robot`: every robot
    has its own. `per: job`: every job has its own.
    """

    parameters: Parameters = []
    values: (
        Annotated[
            Annotated[str, Field(pattern=_LIST), Tag("<text>")]
            | Annotated[list[Scalar], Field(min_length=1, max_length=MAX_CHOICES), Tag("<list>")],
            by_type("a list, or $name of a list", {str: "<text>", list: "<list>"}),
        ]
        | None
    ) = None
    min: Number | None = None
    max: Number | None = None
    decimals: Annotated[int, Field(ge=0, le=MAX_DECIMALS)] = 0
    text: Annotated[int, Field(ge=1, le=MAX_TEXT)] | None = None
    default: Scalar | None = None
    per: Literal["team", "robot", "job"] = "team"

    @model_validator(mode="after")
    def _one_type(self) -> EntryModel:
        is_number = self.min is not None and self.max is not None
        ends = (self.min, self.max) if is_number else (None, None)
        if (self.min, self.max) != ends or (self.values, self.text, ends[0]).count(None) != 2:
            raise PydanticCustomError(
                "expression",
                "an entry has values, or min and max, or text, e.g. {min: 0, max: 9}",
            )
        if self.decimals and not is_number:
            raise PydanticCustomError("expression", "decimals are those of min and max")
        return self


@with_features
class RobotTypeModel(FileModel):
    """A kind of robot: what it can do, and how well.

    `cost`: what one more robot costs, for `mrbt analyze`. `on_lost_contact`: without it a robot
    goes on with its work.
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


@with_features
class NeedModel(FileModel):
    """How many robots a local task needs (`min`, nu) and can use (`max`, mu; default `min`).

    `min: 0`: robots may help with it, and none has to.
    `same_robot_as`: only robots that have succeeded with that before.
    """

    min: Annotated[int, Field(ge=0, le=MAX_ROBOTS)] = 1
    max: Count | None = None
    same_robot_as: SameRobotModel | None = None


class FailurePolicyModel(FileModel):
    """When a global task fails: by `policy`, once the team has agreed on it for `after_s`."""

    policy: Literal["resilient", "paper"] = "resilient"
    after_s: Annotated[float, Field(gt=0, le=MAX_SECONDS)]


class FailAfterModel(FileModel):
    """A global task that fails after it was blocked for this many seconds."""

    fail_after_s: Annotated[float, Field(gt=0, le=MAX_SECONDS)]


Blocked: TypeAlias = Annotated[
    Annotated[Literal["wait"], Tag("<text>")] | Annotated[FailAfterModel, Tag("<mapping>")],
    by_type("wait, or {fail_after_s: 20}", {str: "<text>", dict: "<mapping>"}),
]


@with_features
class GlobalTaskModel(FileModel):
    """A task of the whole team: the local tasks that it needs, and its policies.

    `failure`: once a robot has failed, the task fails when no living robot can still try
    (resilient), by the paper's count of assigned robots that live (paper), or at once (first).
    `blocked`: no robot has failed, and no living one could do it.
    """

    parameters: Parameters = []
    needs: Annotated[dict[CallText, NeedModel], Field(min_length=1)]
    failure: Annotated[
        Annotated[Literal["resilient", "paper", "first"], Tag("<text>")]
        | Annotated[FailurePolicyModel, Tag("<mapping>")],
        by_type("resilient, paper, first, or {after_s: 5}", {str: "<text>", dict: "<mapping>"}),
    ] = "resilient"
    blocked: Blocked | None = None
    preemptive: bool = False


class SubTreeModel(FileModel):
    """A part of a tree that can be used many times, with arguments."""

    parameters: Parameters = []
    tree: Node


class RangeModel(FileModel):
    """Whole numbers from `min` to `max`."""

    min: Annotated[int, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
    max: Annotated[int, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]


JobValues: TypeAlias = Annotated[
    Annotated[str, Field(pattern=_PLACE_OR_LIST), Tag("<text>")]
    | Annotated[list[Scalar], Field(min_length=1, max_length=MAX_CHOICES), Tag("<list>")]
    | Annotated[RangeModel, Tag("<mapping>")],
    by_type(
        "place, a list, $name of a list, or {min: 1, max: 20}",
        {str: "<text>", list: "<list>", dict: "<mapping>"},
    ),
]


class JobTypeModel(FileModel):
    """A type of jobs, which are handed to a team that runs; see docs/how-to/jobs.md.

    `parameters`: the values that each may have: `place` (one of `travel`, or of the map), a list,
    `$name` of a list, or a range of whole numbers. `tree`: what a job does; it may name the
    parameters. `attempts`: a tree that has failed is tried again, so often in all; -1: for ever.
    `priority`: the larger goes first. `deadline_s`: a job expires so long after its submission.
    Both can be given with a job as well. `ends_mission`: the Jobs node ends with the first job of
    this type that ends, as it did.
    """

    parameters: Annotated[dict[Name, JobValues], Field(max_length=MAX_ARGUMENTS)] = {}
    priority: Annotated[int, Field(ge=0, le=MAX_PRIORITY)] = 0
    deadline_s: Annotated[float, Field(gt=0, le=MAX_SECONDS)] | None = None
    attempts: Tries = 1
    ends_mission: bool = False
    tree: Node


RobotEntry: TypeAlias = Annotated[
    Annotated[Name, Tag("<text>")] | Annotated[RobotModel, Tag("<mapping>")],
    by_type(
        "a robot type, or {type: ..., capabilities: {...}}", {str: "<text>", dict: "<mapping>"}
    ),
]


class TravelModel(FileModel):
    """Places, and how long robots are on their way; see docs/how-to/missions.md.

    `places`: their coordinates, or `map`: those of `parameters: map`; without it the places are
    those of `ways`. `speed` in units of the map per second, of all robots or by type. `ways`:
    seconds from one place to another, both ways unless the other is given; they go before
    coordinates. `start`: where the robots are at first, all or each; `way_back`: whether they
    return there. `objective`: whether the end of the mission or the mean end of its tasks is to be
    early. `horizon`: how many tasks a schedule looks ahead, at most. `overtaking`: how often later
    jobs of its priority, or later attempts of loops, may go before a task.
    """

    places: (
        Annotated[
            Annotated[Literal["map"], Tag("<text>")]
            | Annotated[
                Annotated[dict[Place, Point], Field(max_length=MAX_PLACES)], Tag("<mapping>")
            ],
            by_type("map, or {dock: [0, 0], shelf: [3.5, 4]}", {str: "<text>", dict: "<mapping>"}),
        ]
        | None
    ) = None
    speed: (
        Annotated[
            Annotated[Performance, Tag("<number>")]
            | Annotated[dict[Name, Performance], Tag("<mapping>")],
            by_type(
                "a number, or {cart: 0.5, drone: 2}",
                {int: "<number>", float: "<number>", dict: "<mapping>"},
            ),
        ]
        | None
    ) = None
    ways: dict[Place, dict[Place, Way]] = {}
    start: Annotated[
        Annotated[Place, Tag("<text>")] | Annotated[dict[RobotName, Place], Tag("<mapping>")],
        by_type(
            "a place (a number in quotes), or {A1: dock, A2: shelf}",
            {str: "<text>", dict: "<mapping>"},
        ),
    ]
    objective: Literal["makespan", "mean_completion"] = "makespan"
    way_back: Literal["none", "start"] = "none"
    horizon: Annotated[int, Field(ge=1, le=MAX_HORIZON)] = 100
    overtaking: Annotated[int, Field(ge=0, le=MAX_OVERTAKING)] = 5


@with_features
class MissionModel(FileModel):
    """A mission of a team of robots.

    `blocked`: for global tasks that do not say it themselves. `solver`: what solves the assignment
    problem (docs/how-to/constraints.md). `jobs`: types of jobs, which Jobs nodes name.
    `blackboard`: what else robots tell one another (docs/how-to/conditions.md).
    `recorded: required`: a robot that does not record takes no exclusive task.
    """

    removed_keys = {
        "local_conditions": "a robot's trees read what its program knows (@robot.condition, "
        f"@robot.entry), or conditions of the team; {_IN_A_FILE}"
    }
    mission: Name
    program: ProgramText | None = None
    blocked: Blocked = "wait"
    ends: Literal["once", "never"] = "once"
    recorded: Literal["if_possible", "required"] = "if_possible"
    solver: SolverText | None = None
    parameters: dict[Name, JsonValue] = {}
    travel: TravelModel | None = None
    local_tasks: dict[Name, LocalTaskOrTreeModel]
    conditions: dict[Name, ConditionModel] = {}
    blackboard: dict[Name, EntryModel] = {}
    robot_types: dict[Name, RobotTypeModel]
    robots: Annotated[dict[RobotName, RobotEntry], Field(min_length=1, max_length=MAX_ROBOTS)]
    global_tasks: Annotated[dict[Name, GlobalTaskModel], Field(max_length=MAX_GLOBAL_TASKS)] = {}
    subtrees: dict[Name, SubTreeModel] = {}
    jobs: Annotated[dict[Name, JobTypeModel], Field(max_length=MAX_JOB_TYPES)] = {}
    tree: Node


# `Node` names `NodeModel` as a text, which this module cannot resolve by itself.
MissionModel.model_rebuild(_types_namespace={"NodeModel": NodeModel})

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
            place, message = explain(detail, EXPLAINED_HERE)
            report.add(place, message + indentation_hint(detail, place, report.lines))
        if not all(detail["type"] in _STAND_INS for detail in details):
            return None
        # Wrong values, but the right shape: with valid values instead, more can be checked.
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
    """Return the JSON Schema of mission files, as it is committed in `mission.schema.json`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schema |= MissionModel.model_json_schema(by_alias=True)
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    SCHEMA_FILE.write_text(schema_text(), encoding="utf-8")
    sys.stdout.write(f"written: {SCHEMA_FILE}\n")
