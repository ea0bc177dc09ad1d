"""Whether a message fits the JSON Schema of its channel: the part of the standard that those use.

`recording.channels` may use the keywords in `_CHECKS`, and those that say nothing of values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeAlias

# Raises ValueError for a value that does not fit; the text is where it stands.
Check: TypeAlias = Callable[[Any, str], None]

_SAYS_NOTHING = {"$comment", "contentEncoding", "description", "title"}
_TYPES: Mapping[str, Callable[[Any], bool]] = {
    "array": lambda value: isinstance(value, list),
    "boolean": lambda value: isinstance(value, bool),
    "integer": lambda value: _is_number(value) and (isinstance(value, int) or value.is_integer()),
    "null": lambda value: value is None,
    "number": lambda value: _is_number(value),
    "object": lambda value: isinstance(value, dict),
    "string": lambda value: isinstance(value, str),
}


def compile_schema(schema: Mapping[str, Any]) -> Callable[[Any], None]:
    """What raises ValueError for a value that does not fit the schema.

    Raises ValueError itself for a schema with other keywords.
    """
    check = _check(schema)
    return lambda value: check(value, "data")


def _check(schema: Mapping[str, Any]) -> Check:
    unknown = schema.keys() - _CHECKS.keys() - _SAYS_NOTHING
    if unknown:
        raise ValueError(f"no check for {', '.join(sorted(unknown))} of JSON Schema")
    # Some keywords are looked at together.
    makers = dict.fromkeys(make for keyword, make in _CHECKS.items() if keyword in schema)
    checks = [make(schema) for make in makers]
    if len(checks) == 1:
        return checks[0]

    def all_of(value: Any, place: str) -> None:
        for each in checks:
            each(value, place)

    return all_of


def _type(schema: Mapping[str, Any]) -> Check:
    names = schema["type"]
    names = [names] if isinstance(names, str) else list(names)
    kinds, wanted = [_TYPES[name] for name in names], " or ".join(names)

    def check(value: Any, place: str) -> None:
        for is_one in kinds:
            if is_one(value):
                return
        raise ValueError(f"{place} must be {wanted}")

    return check


def _enum(schema: Mapping[str, Any]) -> Check:
    values = [schema["const"]] if "const" in schema else list(schema["enum"])

    def check(value: Any, place: str) -> None:
        # In JSON true is no 1.
        is_bool = isinstance(value, bool)
        if not any(value == each and is_bool == isinstance(each, bool) for each in values):
            raise ValueError(f"{place} must be one of {values}")

    return check


def _bounds(schema: Mapping[str, Any]) -> Check:
    least, most = schema.get("minimum"), schema.get("maximum")

    def check(value: Any, place: str) -> None:
        if not _is_number(value):
            return
        if least is not None and value < least:
            raise ValueError(f"{place} must be at least {least}")
        if most is not None and value > most:
            raise ValueError(f"{place} must be at most {most}")

    return check


def _pattern(schema: Mapping[str, Any]) -> Check:
    # In a schema `$` is the very end.
    pattern = re.compile(re.sub(r"\$$", r"\\Z", schema["pattern"]))

    def check(value: Any, place: str) -> None:
        if isinstance(value, str) and pattern.search(value) is None:
            raise ValueError(f"{place} must match {schema['pattern']}")

    return check


def _items(schema: Mapping[str, Any]) -> Check:
    of_each = _check(schema["items"])

    def check(value: Any, place: str) -> None:
        if isinstance(value, list):
            for number, item in enumerate(value):
                of_each(item, f"{place}[{number}]")

    return check


def _members(schema: Mapping[str, Any]) -> Check:
    required = tuple(schema.get("required", ()))
    known = {name: _check(each) for name, each in schema.get("properties", {}).items()}
    rest = schema.get("additionalProperties", True)
    of_rest = _check(rest) if isinstance(rest, Mapping) else None

    def check(value: Any, place: str) -> None:
        if not isinstance(value, dict):
            return
        for name in required:
            if name not in value:
                raise ValueError(f"{place} must contain {name}")
        for name, item in value.items():
            of_one = known.get(name, of_rest)
            if of_one is not None:
                of_one(item, f"{place}.{name}")
            elif not rest:
                raise ValueError(f"{place} must not contain {name}")

    return check


def _one_of(schema: Mapping[str, Any]) -> Check:
    checks = [_check(each) for each in schema["oneOf"]]

    def fitting(value: Any, place: str) -> Iterator[Check]:
        for each in checks:
            try:
                each(value, place)
            except ValueError:
                continue
            yield each

    def check(value: Any, place: str) -> None:
        if len(list(fitting(value, place))) != 1:
            raise ValueError(f"{place} must be valid by exactly one of {len(checks)} definitions")

    return check


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_CHECKS: Mapping[str, Callable[[Mapping[str, Any]], Check]] = {
    "type": _type,
    "enum": _enum,
    "const": _enum,
    "minimum": _bounds,
    "maximum": _bounds,
    "pattern": _pattern,
    "items": _items,
    "required": _members,
    "properties": _members,
    "additionalProperties": _members,
    "oneOf": _one_of,
}
