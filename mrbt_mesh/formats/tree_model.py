"""Trees in mission files as pydantic models: a node is a mapping with one key, its type."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, Tag, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from mrbt_mesh.core.bt.tree import MAX_NODES, Kind
from mrbt_mesh.core.mission.mission import MAX_AT_MOST, MAX_JOB_TYPES
from mrbt_mesh.core.mission.names import NAME_PATTERN, ROBOT_PATTERN
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.file_model import (
    CALL_HINT,
    EXPLAINED,
    FileModel,
    Name,
    by_type,
    call_pattern,
    one_of,
)

MAX_SECONDS = 1e9
# The word for all job types in a Jobs node.
ALL_TYPES = "all"

_ARGUMENT = r"[A-Za-z0-9_.+$-]{1,64}"
_CALL = call_pattern(rf"\s*{_ARGUMENT}\s*")
_OPERATOR = r"\s*([=!<>]=|[<>])\s*"
_CONDITION = rf"{_CALL[:-1]}((@{ROBOT_PATTERN})?{_OPERATOR}{_ARGUMENT})?$"
_REFERENCE = rf"^\${NAME_PATTERN}$"
_TITLE = r"^[^/\n]{1,64}$"

TREE_EXPLAINED = EXPLAINED | {
    _CALL: f"{CALL_HINT}, e.g. fix_hw or fix_hw($part)",
    _CONDITION: "a condition, or a comparison of a blackboard entry with a value, is expected, e.g."
    " broken($part) or found == red",
    _REFERENCE: "a list or the name of a parameter is expected, e.g. [1, 2] or $parts",
    _TITLE: "1 to 64 characters without / are expected",
}

CallText: TypeAlias = Annotated[str, Field(pattern=_CALL)]
ConditionText: TypeAlias = Annotated[str, Field(pattern=_CONDITION)]
Title: TypeAlias = Annotated[str, Field(pattern=_TITLE)]


def split_comparison(text: str) -> tuple[str, str, str] | None:
    """Split `battery@A1 < 30` into ("battery@A1", "<", "30"); None if it is not a comparison."""
    found = re.fullmatch(rf"(.+?){_OPERATOR}(.+)", text)
    return None if found is None else (found[1], found[2], found[3])


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


Scalar: TypeAlias = Annotated[
    str | int | float | bool,
    one_of("text, a number, true or false", lambda v: isinstance(v, str | int | float)),
    WithJsonSchema({"type": ["string", "number", "boolean"]}),
]
Success: TypeAlias = Annotated[
    Literal["all", "any"] | int,
    one_of("all, any, or a number from 1", lambda v: v in ("all", "any") or _is_count(v)),
    WithJsonSchema({"anyOf": [{"enum": ["all", "any"]}, {"type": "integer", "minimum": 1}]}),
]
Tries: TypeAlias = Annotated[
    int,
    one_of(
        "a number from 1, or -1 for no limit",
        lambda v: _is_count(v) or (_is_integer(v) and v == -1),
    ),
    WithJsonSchema({"anyOf": [{"const": -1}, {"type": "integer", "minimum": 1}]}),
]


def _is_count(value: Any) -> bool:
    return _is_integer(value) and 1 <= value <= 1_000_000_000


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
    by_type(TREE_EXPLAINED[_REFERENCE], {str: "<text>", list: "<list>"}),
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
        if self.do is None and self.for_each is not None:
            raise PydanticCustomError("children", "do is missing: the node for each of the values")
        if self.for_each is None and self.do is not None:
            raise PydanticCustomError("children", "for_each is missing, e.g. {item: $items}")
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


JobTypes: TypeAlias = Annotated[list[Name], Field(min_length=1, max_length=MAX_JOB_TYPES)]


class JobsModel(FileModel):
    """The open jobs of these types (`all`: of all), all at once.

    `at_most`: how many jobs of each type are in the tree at a time; default: twice the robots.
    """

    types: Annotated[
        Annotated[Name, Tag("<text>")] | Annotated[JobTypes, Tag("<list>")],
        by_type("all, or a list of job types", {str: "<text>", list: "<list>"}),
    ] = ALL_TYPES
    at_most: Annotated[int, Field(ge=1, le=MAX_AT_MOST)] | None = None


JobsBody: TypeAlias = Annotated[
    Annotated[Name, Tag("<text>")]
    | Annotated[JobTypes, Tag("<list>")]
    | Annotated[JobsModel, Tag("<mapping>")],
    by_type(
        "all, a list of job types, or {types: [...], at_most: 20}",
        {str: "<text>", list: "<list>", dict: "<mapping>"},
    ),
]

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
    condition: ConditionText = _kind(Kind.CONDITION)
    inverter: Node = _kind(Kind.INVERTER)
    force_success: Node = _kind(Kind.FORCE_SUCCESS)
    force_failure: Node = _kind(Kind.FORCE_FAILURE)
    retry: RetryModel = _kind(Kind.RETRY)
    repeat: RepeatModel = _kind(Kind.REPEAT)
    timeout: TimeoutModel = _kind(Kind.TIMEOUT)
    keep_running: Node = _kind(Kind.KEEP_RUNNING_UNTIL_FAILURE)
    subtree: CallText = _kind(Kind.SUBTREE)
    jobs: JobsBody = _kind(Kind.JOBS)

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
        """Return the type of the node and the value under it."""
        (name,) = self.model_fields_set
        return Kind(str(type(self).model_fields[name].alias)), getattr(self, name)


def _exactly_one_key(schema: dict[str, Any]) -> None:
    schema["minProperties"] = schema["maxProperties"] = 1
    for kind in schema["properties"].values():
        kind.pop("default", None)
