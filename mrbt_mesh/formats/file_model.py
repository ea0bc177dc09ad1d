"""What the models of all YAML files share: mappings, unions, and errors in plain words.

Every alternative of a union carries a tag in angle brackets, so that a place in the model can be
turned back into a place in the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, ClassVar, TypeAlias, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import ErrorDetails, PydanticCustomError

from mrbt_mesh.core.mission.mission import MAX_ROBOTS
from mrbt_mesh.core.mission.names import (
    ARGUMENT_PATTERN,
    MAX_ARGUMENTS,
    NAME_PATTERN,
    ROBOT_PATTERN,
)
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.yaml_source import SourceDict

_Model = TypeVar("_Model", bound=BaseModel)
_NAME = f"^{NAME_PATTERN}$"
_ROBOT = f"^{ROBOT_PATTERN}$"
_REPEAT = f"{{0,{MAX_ARGUMENTS - 1}}}"
_GROUND_ARGUMENT = rf"\s*{ARGUMENT_PATTERN}\s*"


def call_pattern(argument: str) -> str:
    """Return the pattern of a name with arguments that match `argument`."""
    return rf"^{NAME_PATTERN}(\({argument}(,{argument}){_REPEAT}\))?$"


_GROUND = call_pattern(_GROUND_ARGUMENT)

CALL_HINT = f"a name with at most {MAX_ARGUMENTS} arguments is expected"
EXPLAINED: dict[str, str] = {
    _NAME: "a name is expected: a letter or _, then at most 63 letters, digits or _",
    _ROBOT: "a robot id is expected: 1 to 32 letters, digits, _ or -, the first no _ or -",
    _GROUND: f"{CALL_HINT}, e.g. do_diagnosis or do_diagnosis(3)",
}

Name: TypeAlias = Annotated[str, Field(pattern=_NAME)]
RobotName: TypeAlias = Annotated[str, Field(pattern=_ROBOT)]
GroundText: TypeAlias = Annotated[str, Field(pattern=_GROUND)]
Count: TypeAlias = Annotated[int, Field(ge=1, le=MAX_ROBOTS)]


def by_type(expected: str, tags: dict[type, str]) -> Discriminator:
    """Choose the alternative of a union by the type of the value in the file."""

    def tag(value: Any) -> str | None:
        return next((tags[kind] for kind in tags if isinstance(value, kind)), None)

    return Discriminator(tag, custom_error_type="shape", custom_error_message=expected)


def one_of(expected: str, accepts: Callable[[Any], bool]) -> PlainValidator:
    """Return a validator of values for which `accepts` is true; `expected` is for the message."""

    def check(value: Any) -> Any:
        if not accepts(value):
            raise PydanticCustomError("shape", expected)
        return value

    return PlainValidator(check)


class FileModel(BaseModel):
    """A mapping of the file. Unknown keys are reported, with the key that was meant.

    `removed_keys`: what to do in place of a key that earlier versions had.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)
    removed_keys: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def known_keys(cls) -> list[str]:
        """Return the keys that the mapping may have."""
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
                remedy = cls.removed_keys.get(key)
                hint = nearest(key, known) if remedy is None else f": {remedy}"
                if not key.isidentifier():
                    hint += '; text with commas or brackets needs quotes, e.g. "go(1, 2)"'
                report.add((*data.path, key), f"unknown key {key!r}{hint}")
        return {key: value for key, value in data.items() if key in known}


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


def place_of(detail: ErrorDetails) -> SourcePath:
    """Return the place in the file: the location in the models without tags of unions and keys."""
    return tuple(
        part for part in detail["loc"] if isinstance(part, int) or part[:1] not in ("<", "[")
    )


def read_model(
    kind: type[_Model], data: Any, report: Report, explained: Mapping[str, str] = EXPLAINED
) -> _Model:
    """Return the file's content as this model; for `explained` see `explain`.

    Raises FileError with everything that is wrong with its shape.
    """
    try:
        return kind.model_validate(data, context=report)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            report.add(*explain(detail, explained))
    report.raise_if_any()
    raise AssertionError("what is refused has problems")


def explain(
    detail: ErrorDetails, explained: Mapping[str, str] = EXPLAINED
) -> tuple[SourcePath, str]:
    """Return the place of a problem in the file, and a message.

    `explained` maps patterns to what they expect.
    """
    place = place_of(detail)
    kind, value, context = detail["type"], detail["input"], detail.get("ctx", {})
    if kind == "missing":
        return place[:-1], f"the key {place[-1]!r} is missing"
    if kind in ("node", "children", "expression"):
        return place, detail["msg"]
    if kind == "shape":
        expected = detail["msg"]
        expected = expected if " expected" in expected else f"{expected} is expected"
    elif kind == "string_pattern_mismatch":
        expected = explained[context["pattern"]]
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
