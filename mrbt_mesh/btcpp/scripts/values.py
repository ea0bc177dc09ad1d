"""Values of a blackboard and how BehaviorTree.CPP makes one type of another.

Integers are of 64 bits, real numbers are doubles, texts are texts; a boolean is stored as 0 or 1.
Anything else is kept as it is. Source: BehaviorTree.CPP's `Any` and `convertFromString`.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

# C++ names of Python's types; of others nothing is known.
CPP_TYPES: Mapping[type, str] = {
    int: "int64_t",
    float: "double",
    bool: "bool",
    str: "std::string",
}
# The C++ type of an entry that may be anything, to which the library cannot convert a text.
ANY_TYPE = "BT::Any"
INT64 = range(-(2**63), 2**63)
# The largest integer below which a double holds every one.
EXACT = 2**53 - 1

_LEADING_NUMBER = re.compile(
    r"-?(inf|nan|([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?)", re.ASCII | re.IGNORECASE
)
_INTEGER = re.compile(r"[+-]?[0-9]+\s*", re.ASCII)
# What C++ reads as a real number, where that is the whole text.
_REAL = re.compile(
    r"-?(inf|infinity|nan|([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?)", re.ASCII | re.IGNORECASE
)

# Names of C++ types, by what they are here.
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
    """A value that cannot be taken for one of the type that is needed."""


def type_of_value(value: Any) -> str:
    """The C++ type of what a program writes; "" for what has none here."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int" if -(2**31) <= value < 2**31 else "int64_t"
    return {float: "double", str: "std::string"}.get(type(value), "")


def read_boolean(text: str) -> bool | None:
    """A boolean as BehaviorTree.CPP reads it, None for anything else."""
    if text in ("1", "true", "TRUE", "True"):
        return True
    return False if text in ("0", "false", "FALSE", "False") else None


def read_real(text: str) -> float | None:
    """The real number that the whole text is to C++'s `from_chars`; None for anything else.

    Not Python's: no `+`, no `_`, no digits of other scripts, nothing that a double cannot hold.
    """
    if _REAL.fullmatch(text) is None:
        return None
    number = float(text)
    is_named = text[-1].isalpha()
    is_lost = math.isinf(number) or (number == 0 and re.search("[1-9]", text.lower().split("e")[0]))
    return number if is_named or not is_lost else None


def leading_real(text: str) -> float | None:
    """The real number with which a text begins, as the library reads a port; None if with none."""
    match = _LEADING_NUMBER.match(text)
    return None if match is None else read_real(match[0])


def as_number(value: Any) -> float:
    """As a double."""
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
    """As an integer of 64 bits."""
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
    """As an integer of this C++ type: nothing is cut off, nothing out of its range."""
    number = as_integer(value)
    if number not in _RANGES[type_name]:
        raise ValueTypeError(f"{number} is out of the range of {type_name}")
    return number


def is_in_range(number: int, type_name: str) -> bool:
    """Whether an integer of this C++ type can have this value."""
    return number in _RANGES[type_name]


def as_truth(value: Any) -> bool:
    """As a boolean: an integer has to be 0 or 1, a real number must not be negative."""
    if isinstance(value, float) and not value < 0:
        return value != 0
    if isinstance(value, int) and value in (0, 1):
        return bool(value)
    if value is None:
        raise ValueTypeError("there is no value")
    kind = "the text " if isinstance(value, str) else ""
    raise ValueTypeError(f"{kind}{value!r} is neither true nor false")


def as_text(value: Any) -> str:
    """As C++'s std::to_string writes it: 6 decimals for a number that is no integer."""
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return f"{value:f}"
    if isinstance(value, int):
        return str(int(value))
    raise ValueTypeError(f"{value!r} cannot be written as a text")


def copied_into(before: Any, value: Any) -> Any:
    """`value` in the place of `before`, whose type it takes."""
    if before is None or type(before) is type(value):
        return value
    if isinstance(before, int) and isinstance(value, int | float):
        return as_integer(value)
    if isinstance(before, float) and isinstance(value, int | float):
        return as_number(value)
    raise ValueTypeError(f"{value!r} cannot take the place of {before!r}")


def as_type(value: Any, type_name: str) -> Any:
    """A value that is no text as one of this C++ type; as it is for types that are no numbers.

    Items of a list are converted, too; numbers of other libraries are what Python takes them for.
    """
    if not _is_numeric(type_name):
        return _as_list(value, type_name) if isinstance(value, list) else value
    if not isinstance(value, int | float):
        value = _plain_number(value, type_name)
    if type_name in REALS:
        return as_number(value)
    return as_truth(value) if type_name == "bool" else as_integer_of(value, type_name)


def list_item(type_name: str) -> str | None:
    """The type of a list's items; None for types that are no lists."""
    match = _LISTS.fullmatch(type_name)
    return None if match is None else match[1] or match[2]


def _as_list(values: list[Any], type_name: str) -> list[Any]:
    """The same list if there is nothing to convert."""
    item = list_item(type_name) or ""
    if not _is_numeric(item):
        return values
    items = [read_text(v, item) if isinstance(v, str) else as_type(v, item) for v in values]
    is_same = all(type(new) is type(old) for new, old in zip(items, values, strict=True))
    return values if is_same else items


def _is_numeric(type_name: str) -> bool:
    return type_name in INTEGERS or type_name in REALS or type_name == "bool"


def _plain_number(value: Any, type_name: str) -> int | float:
    """A number that is none of Python's own, like numpy's."""
    for method, number in (("__index__", int), ("__float__", float), ("__bool__", bool)):
        is_wanted = method != "__bool__" or type_name == "bool"
        if is_wanted and hasattr(value, method):
            try:
                return number(value)
            except (TypeError, ValueError):
                break
    raise ValueTypeError(f"{value!r:.80} is not a value of the type {type_name}")


def read_text(text: str, type_name: str, enums: Mapping[str, int] | None = None) -> Any:
    """What a text means where a value of this C++ type is needed; a text for types unknown here.

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
    """The items of a list, as BehaviorTree.CPP splits it: a last `;` ends the list."""
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
