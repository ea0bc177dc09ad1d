"""Values of a blackboard, and how BehaviorTree.CPP converts between their types.

Integers have 64 bits, real numbers are doubles, and a boolean is stored as 0 or 1. Other values are
kept unchanged. Source: BehaviorTree.CPP's `Any` and `convertFromString`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

# The C++ names of Python types; other types have none.
CPP_TYPES: Mapping[type, str] = {
    int: "int64_t",
    float: "double",
    bool: "bool",
    str: "std::string",
}
# The C++ type of an entry that may hold anything. BehaviorTree.CPP cannot convert a text to it.
ANY_TYPE = "BT::Any"
INT64 = range(-(2**63), 2**63)
# The largest integer up to which a double holds every integer exactly.
EXACT = 2**53 - 1

_LEADING_NUMBER = re.compile(
    r"-?(inf|nan|([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?)", re.ASCII | re.IGNORECASE
)
_INTEGER = re.compile(r"[+-]?[0-9]+\s*", re.ASCII)
# A whole text that C++ reads as a real number.
_REAL = re.compile(
    r"-?(inf|infinity|nan|([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?)", re.ASCII | re.IGNORECASE
)

# The ranges of C++ integer types, by their names.
_RANGES = {
    "int": range(-(2**31), 2**31),
    "int32_t": range(-(2**31), 2**31),
    "short": range(-(2**15), 2**15),
    "int16_t": range(-(2**15), 2**15),
    "int8_t": range(-(2**7), 2**7),
    "long": INT64,
    "int64_t": INT64,
    "unsigned int": range(2**32),
    "unsigned": range(2**32),
    "uint32_t": range(2**32),
    "uint16_t": range(2**16),
    "uint8_t": range(2**8),
    "uint64_t": range(2**64),
    "unsigned long": range(2**64),
    "size_t": range(2**64),
}
INTEGERS = frozenset(_RANGES)
REALS = ("double", "float")
_LISTS = re.compile(r"std::(?:vector|deque)<(.+?)(?:,.*)?>|list<(.+)>", re.ASCII)


class ValueTypeError(ValueError):
    """A value cannot be converted to the type that is needed."""


def type_of_value(value: Any) -> str:
    """Return the C++ type of a value that a program writes; "" if it has none."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int" if -(2**31) <= value < 2**31 else "int64_t"
    return {float: "double", str: "std::string"}.get(type(value), "")


def read_boolean(text: str) -> bool | None:
    """Read a boolean as BehaviorTree.CPP does; None for any other text."""
    if text in ("1", "true", "TRUE", "True"):
        return True
    return False if text in ("0", "false", "FALSE", "False") else None


def read_real(text: str) -> float | None:
    """Read a whole text as a real number like C++'s `from_chars`; None for any other text.

    Unlike in Python: no `+`, no `_`, ASCII digits only, and no number out of a double's range.
    """
    if _REAL.fullmatch(text) is None:
        return None
    number = float(text)
    is_named = text[-1].isalpha()
    is_lost = math.isinf(number) or (number == 0 and re.search("[1-9]", text.lower().split("e")[0]))
    return number if is_named or not is_lost else None


def leading_real(text: str) -> float | None:
    """Return the real number at the start of a text, as BehaviorTree.CPP reads a port, or None."""
    match = _LEADING_NUMBER.match(text)
    return None if match is None else read_real(match[0])


def as_number(value: Any) -> float:
    """Convert a value to a double. Raises ValueTypeError."""
    if isinstance(value, float):
        return value
    if isinstance(value, int):
        if abs(value) > EXACT:
            raise ValueTypeError(f"{value} is too large for an exact real number")
        return float(value)
    if isinstance(value, str):
        match = _LEADING_NUMBER.match(value)
        if match is None:
            raise ValueTypeError(f"the text {value!r} is not a number")
        return float(match[0])
    raise ValueTypeError(f"{value!r} is not a number" if value is not None else "there is no value")


def as_integer(value: Any) -> int:
    """Convert a value to a 64-bit integer. Raises ValueTypeError."""
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        if not math.isfinite(value) or value != round(value) or int(value) not in INT64:
            raise ValueTypeError(f"{value!r} is not an integer")
        return int(value)
    if isinstance(value, str) and (match := re.match(r"-?[0-9]+", value, re.ASCII)):
        return int(match[0])
    raise ValueTypeError(f"{value!r} is not an integer")


def as_integer_of(value: Any, type_name: str) -> int:
    """Convert a value to this C++ integer type. Raises ValueTypeError if it is out of range."""
    number = as_integer(value)
    if number not in _RANGES[type_name]:
        raise ValueTypeError(f"{number} is out of the range of {type_name}")
    return number


def is_in_range(number: int, type_name: str) -> bool:
    """Return whether `number` is in the range of this C++ integer type."""
    return number in _RANGES[type_name]


def as_truth(value: Any) -> bool:
    """Convert a value to a boolean: an integer 0 or 1, or a real number that is not negative.

    Raises ValueTypeError for any other value.
    """
    if isinstance(value, float) and not value < 0:
        return value != 0
    if isinstance(value, int) and value in (0, 1):
        return bool(value)
    if value is None:
        raise ValueTypeError("there is no value")
    kind = "the text " if isinstance(value, str) else ""
    raise ValueTypeError(f"{kind}{value!r} is neither true nor false")


def as_text(value: Any) -> str:
    """Convert a value to a text like C++'s std::to_string: 6 decimals for a real number.

    Raises ValueTypeError for a value that is neither a number nor a text.
    """
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:f}"
    if isinstance(value, int):
        return str(int(value))
    raise ValueTypeError(f"{value!r} cannot be written as a text")


def copied_into(before: Any, value: Any) -> Any:
    """Convert `value` to the type of `before`, which it replaces. Raises ValueTypeError."""
    if before is None or type(before) is type(value):
        return value
    if isinstance(before, int) and isinstance(value, int | float):
        return as_integer(value)
    if isinstance(before, float) and isinstance(value, int | float):
        return as_number(value)
    raise ValueTypeError(f"{value!r} cannot take the place of {before!r}")


def as_type(value: Any, type_name: str) -> Any:
    """Convert a value other than a text to this C++ type; only numeric types convert.

    Items of a list are converted, too. Numbers of other libraries, such as numpy's, become Python
    numbers first. Raises ValueTypeError.
    """
    if not _is_numeric(type_name):
        return _as_list(value, type_name) if isinstance(value, list) else value
    if not isinstance(value, int | float):
        value = _plain_number(value, type_name)
    if type_name in REALS:
        return as_number(value)
    return as_truth(value) if type_name == "bool" else as_integer_of(value, type_name)


def list_item(type_name: str) -> str | None:
    """Return the item type of a list type; None for other types."""
    match = _LISTS.fullmatch(type_name)
    return None if match is None else match[1] or match[2]


def _as_list(values: list[Any], type_name: str) -> list[Any]:
    """Convert the items of a list; returns the same list if there is nothing to convert."""
    item = list_item(type_name) or ""
    if not _is_numeric(item):
        return values
    items = [read_text(v, item) if isinstance(v, str) else as_type(v, item) for v in values]
    is_same = all(type(new) is type(old) for new, old in zip(items, values, strict=True))
    return values if is_same else items


def _is_numeric(type_name: str) -> bool:
    return type_name in INTEGERS or type_name in REALS or type_name == "bool"


def _plain_number(value: Any, type_name: str) -> int | float:
    """Convert a number of another library, such as numpy's, to a Python number."""
    for method, number in (("__index__", int), ("__float__", float), ("__bool__", bool)):
        is_wanted = method != "__bool__" or type_name == "bool"
        if is_wanted and hasattr(value, method):
            try:
                return number(value)
            except (TypeError, ValueError):
                break
    raise ValueTypeError(f"{value!r:.80} is not a value of the type {type_name}")


def read_text(text: str, type_name: str, enums: Mapping[str, int] | None = None) -> Any:
    """Read a text as a value of this C++ type; for unknown types it stays a text.

    Raises ValueTypeError.
    """
    if type_name in _RANGES:
        return _read_integer(text, type_name, enums or {})
    if type_name in REALS:
        number = read_real(text.rstrip())
        if number is None:
            raise ValueTypeError(f"the text {text!r} is not a real number")
        return number
    if type_name == "bool":
        truth = read_boolean(text)
        if truth is None:
            raise ValueTypeError(f"the text {text!r} is neither true nor false")
        return truth
    if text.startswith("json:"):
        try:
            return json.loads(text[5:])
        except ValueError as error:
            raise ValueTypeError(f"{text[:80]!r} is not JSON: {error}") from None
    if (kind := list_item(type_name)) is not None:
        return [read_text(item, kind, enums) for item in split_items(text)]
    return text


def split_items(text: str) -> list[str]:
    """Split a list at `;` like BehaviorTree.CPP; a trailing `;` adds no empty item."""
    items = text.split(";")
    return items if items[-1] else items[:-1]


def _read_integer(text: str, type_name: str, enums: Mapping[str, int]) -> int:
    if text in enums:
        return enums[text]
    if not _INTEGER.fullmatch(text) or len(text) > 30:
        raise ValueTypeError(f"the text {text!r} is not an integer")
    if int(text) not in _RANGES[type_name]:
        raise ValueTypeError(f"{text} is out of the range of {type_name}")
    return int(text)
