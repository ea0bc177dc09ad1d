"""The mission file as pydantic models: shapes, types and ranges, and the JSON Schema.

What needs more than one place of the file (is this task declared, do the arguments fit)
is checked in `expand` and `build`. Every alternative of a union carries a tag in angle
brackets, so that a place in the model can be turned back into a place in the file.

Write the schema anew with `python -m mrbt_mesh.formats.mission_model`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    JsonValue,
    PlainValidator,
    Tag,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from mrbt_mesh.core.mission import (
    ARGUMENT_PATTERN,
    MAX_ARGUMENTS,
    MAX_GLOBAL_TASKS,
    MAX_ROBOTS,
    NAME_PATTERN,
    ROBOT_PATTERN,
)
from mrbt_mesh.core.tree import MAX_NODES, Kind
from mrbt_mesh.formats.problems import Report, SourcePath, found, nearest
from mrbt_mesh.formats.yaml_source import SourceDict

MAX_PERFORMANCE_UNITS = 1e6
MAX_WORK = 1e9
MAX_SECONDS = 1e9
SCHEMA_FILE = Path(__file__).with_name("mission.schema.json")

_NAME = f"^{NAME_PATTERN}$"
_ROBOT = f"^{ROBOT_PATTERN}$"
_OPEN_ARGUMENT = r"\s*[A-Za-z0-9_.+$-]{1,64}\s*"
_GROUND_ARGUMENT = rf"\s*{ARGUMENT_PATTERN}\s*"
_REPEAT = f"{{0,{MAX_ARGUMENTS - 1}}}"


def _call_pattern(argument: str) -> str:
    return rf"^{NAME_PATTERN}(\({argument}(,{argument}){_REPEAT}\))?$"


_CALL = _call_pattern(_OPEN_ARGUMENT)
_GROUND = _call_pattern(_GROUND_ARGUMENT)
_REFERENCE = rf"^\${NAME_PATTERN}$"
_PROGRAM = r"^[^\n]+\.py(:[A-Za-z_][A-Za-z0-9_]*)?$"
_TITLE = r"^[^/\n]{1,64}$"

_CALL_HINT = f"a name with at most {MAX_ARGUMENTS} arguments is expected"
_EXPLAINED = {
    _NAME: "a name is expected: a letter or _, then at most 63 letters, digits or _",
    _ROBOT: "a robot id is expected: 1 to 32 letters, digits, _ or -, the first no _ or -",
    _CALL: f"{_CALL_HINT}, e.g. fix_hw or fix_hw($part)",
    _GROUND: f"{_CALL_HINT}, e.g. do_diagnosis or do_diagnosis(3)",
    _REFERENCE: "a list or the name of a parameter is expected, e.g. [1, 2] or $parts",
    _PROGRAM: "a Python file is expected, e.g. robot.py or robot.py:name",
    _TITLE: "1 to 64 characters without / are expected",
}

Name: TypeAlias = Annotated[str, Field(pattern=_NAME)]
RobotName: TypeAlias = Annotated[str, Field(pattern=_ROBOT)]
CallText: TypeAlias = Annotated[str, Field(pattern=_CALL)]
GroundText: TypeAlias = Annotated[str, Field(pattern=_GROUND)]
Title: TypeAlias = Annotated[str, Field(pattern=_TITLE)]
Parameters: TypeAlias = Annotated[list[Name], Field(max_length=MAX_ARGUMENTS)]
Performance: TypeAlias = Annotated[float, Field(gt=0, le=MAX_PERFORMANCE_UNITS)]
Count: TypeAlias = Annotated[int, Field(ge=1, le=MAX_ROBOTS)]


def _by_type(expected: str, tags: dict[type, str]) -> Discriminator:
    """Choose the alternative of a union by the type of the value in the file."""

    def tag(value: Any) -> str | None:
        return next((tags[kind] for kind in tags if isinstance(value, kind)), None)

    return Discriminator(tag, custom_error_type="shape", custom_error_message=expected)


def _one_of(expected: str, accepts: Callable[[Any], bool]) -> PlainValidator:
    def check(value: Any) -> Any:
        if not accepts(value):
            raise PydanticCustomError("shape", expected)
        return value

    return PlainValidator(check)


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


Scalar: TypeAlias = Annotated[
    str | int | float | bool,
    _one_of("text, a number, true or false", lambda v: isinstance(v, str | int | float)),
    WithJsonSchema({"type": ["string", "number", "boolean"]}),
]
Success: TypeAlias = Annotated[
    Literal["all", "any"] | int,
    _one_of("all, any, or a number from 1", lambda v: v in ("all", "any") or _at_least(v, 1)),
    WithJsonSchema({"anyOf": [{"enum": ["all", "any"]}, {"type": "integer", "minimum": 1}]}),
]
Tries: TypeAlias = Annotated[
    int,
    _one_of("a number from 1, or -1 for no limit", lambda v: _at_least(v, 1) or _is_minus_one(v)),
    WithJsonSchema({"anyOf": [{"const": -1}, {"type": "integer", "minimum": 1}]}),
]


def _at_least(value: Any, least: int) -> bool:
    return _is_integer(value) and least <= value <= 1_000_000_000


def _is_minus_one(value: Any) -> bool:
    return _is_integer(value) and value == -1


class FileModel(BaseModel):
    """A mapping of the mission file. Unknown keys are reported, with the key that was meant."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    @classmethod
    def known_keys(cls) -> list[str]:
        """The keys that the mapping may have."""
        return [field.alias or name for name, field in cls.model_fields.items()]

    @model_validator(mode="before")
    @classmethod
    def _report_unknown_keys(cls, data: Any, info: ValidationInfo) -> Any:
        report = info.context
        if not isinstance(report, Report) or not isinstance(data, SourceDict):
            return data
        known = cls.known_keys()
        for key in data:
            if report.is_full:
                break
            if key not in known:
                hint = nearest(key, known)
                if not key.isidentifier():
                    hint += '; text with commas or brackets needs quotes, e.g. "go(1, 2)"'
                report.add((*data.path, key), f"unknown key {key!r}{hint}")
        return {key: value for key, value in data.items() if key in known}


class LocalTaskModel(FileModel):
    """A local-task type; a robot with performance p needs work / p seconds for it."""

    parameters: Parameters = []
    work: Annotated[float, Field(gt=0, le=MAX_WORK)] = 1.0


class ConditionModel(FileModel):
    """A condition; while nobody has set it, it reads as `default`."""

    parameters: Parameters = []
    default: bool = False


class RobotTypeModel(FileModel):
    """A kind of robot: what it can do, and how well."""

    capabilities: dict[GroundText, Performance]


class RobotModel(FileModel):
    """A robot that differs from its type; null takes a capability away."""

    type: Name
    capabilities: dict[GroundText, Performance | None] = {}


class NeedModel(FileModel):
    """How many robots a local task needs (`min`, nu) and can use (`max`, mu; default `min`)."""

    min: Count = 1
    max: Count | None = None


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
        _by_type("wait, or {fail_after_s: 20}", {str: "<text>", dict: "<mapping>"}),
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
    _by_type(
        "a node, e.g. {Sequence: [...]} or an action's name", {str: "<text>", dict: "<mapping>"}
    ),
]
Nodes: TypeAlias = Annotated[
    Annotated[CallText, Tag("<text>")]
    | Annotated["NodeModel", Tag("<mapping>")]
    | Annotated[list[Node], Tag("<list>")],
    _by_type("a node or a list of nodes", {str: "<text>", dict: "<mapping>", list: "<list>"}),
]
ForEach: TypeAlias = Annotated[
    Annotated[str, Field(pattern=_REFERENCE), Tag("<text>")]
    | Annotated[list[Scalar], Tag("<list>")],
    _by_type(_EXPLAINED[_REFERENCE], {str: "<text>", list: "<list>"}),
]


class CompositeModel(FileModel):
    """The children of a Sequence or Fallback: a list, and one `do` for each of some values."""

    name: Title | None = None
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
    """A Parallel, which succeeds once `success` of its children have (the paper's M)."""

    success: Success = "all"


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


_LIST_OR_MAPPING = _by_type(
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
    _by_type(
        "a robot type, or {type: ..., capabilities: {...}}", {str: "<text>", dict: "<mapping>"}
    ),
]


class MissionModel(FileModel):
    """A mission of a team of robots."""

    mission: Name
    program: Annotated[str, Field(pattern=_PROGRAM)] | None = None
    parameters: dict[Name, JsonValue] = {}
    local_tasks: dict[Name, LocalTaskModel]
    conditions: dict[Name, ConditionModel] = {}
    robot_types: dict[Name, RobotTypeModel]
    robots: Annotated[dict[RobotName, RobotEntry], Field(min_length=1, max_length=MAX_ROBOTS)]
    global_tasks: Annotated[dict[Name, GlobalTaskModel], Field(max_length=MAX_GLOBAL_TASKS)] = {}
    subtrees: dict[Name, SubTreeModel] = {}
    tree: Node


_EXPECTED = {
    "model_type": "a mapping (key: value)",
    "dict_type": "a mapping (key: value)",
    "list_type": "a list",
    "string_type": "text",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "recursion_loop": "fewer levels of nodes",
}
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
            report.add(*_explain(detail))
        if not all(detail["type"] in _STAND_INS for detail in details):
            return None
        # Wrong values, but the right shape: with others in their place, more can be checked.
        _replace_wrong_values(data, details)
    return None


def _replace_wrong_values(data: dict[str, Any], details: list[ErrorDetails]) -> None:
    for detail in details:
        *parents, last = _place(detail)
        container: Any = data
        for part in parents:
            container = container[part]
        container[last] = _STAND_INS[detail["type"]]


def _place(detail: ErrorDetails) -> SourcePath:
    """Where in the file: the location in the models without the tags of unions and keys."""
    return tuple(
        part for part in detail["loc"] if isinstance(part, int) or part[:1] not in ("<", "[")
    )


def _explain(detail: ErrorDetails) -> tuple[SourcePath, str]:
    place = _place(detail)
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "missing":
        return place[:-1], f"the key {place[-1]!r} is missing"
    if kind in ("node", "children"):
        return place, detail["msg"]
    if kind == "shape":
        expected = detail["msg"]
        expected = expected if " expected" in expected else f"{expected} is expected"
    elif kind == "string_pattern_mismatch":
        expected = _EXPLAINED[context["pattern"]]
    elif kind in _EXPECTED:
        expected = f"{_EXPECTED[kind]} is expected"
    elif kind == "literal_error":
        expected = f"{context['expected']} is expected".replace("'", "")
    elif kind in ("too_short", "too_long"):
        bound = context.get("min_length", context.get("max_length"))
        word = "at least" if kind == "too_short" else "at most"
        return place, f"{word} {bound} expected, found {len(value)}"
    else:
        limits = {"greater_than": "gt", "greater_than_equal": "ge", "less_than_equal": "le"}
        words = {"gt": "above", "ge": "of at least", "le": "of at most"}
        name = limits.get(kind)
        if name is None:
            return place, f"{detail['msg']}, found {found(value)}"
        expected = f"a number {words[name]} {context[name]:g} is expected"
    return place, f"{expected}, found {found(value)}"


def schema_text() -> str:
    """The JSON Schema of mission files, as it is committed in `mission.schema.json`."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schema |= MissionModel.model_json_schema(by_alias=True)
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    SCHEMA_FILE.write_text(schema_text(), encoding="utf-8")
    sys.stdout.write(f"written: {SCHEMA_FILE}\n")
