"""Converts plain data to ROS messages, and message fields to plain data, checking their types.

Of ROS this needs only message classes, which list their fields (`get_fields_and_field_types`).
"""

from __future__ import annotations

import difflib
import importlib
import math
import re
from typing import Any

# Longer lists are truncated.
MAX_ITEMS = 2_000
TIME = "builtin_interfaces/Time"
# The fields of a result that usually hold the reason of a failure.
REASONS = ("error_msg", "error_string", "message", "error_code")

_ITEMS = re.compile(r"sequence<(.+?)(?:, \d+)?>|(.+)\[(\d+)\]")
_INTEGER = re.compile(r"(u?)int(8|16|32|64)")
_STRING = re.compile(r"w?string(<\d+>)?")
_PLACE = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
_STEP = re.compile(r"\.?([A-Za-z_]\w*)|\[(-?\d+)\]")


class UnfitError(Exception):
    """A value does not fit its type; the text has the place and what is expected.

    `path` are the keys that lead to the value, `what` is the text without the place.
    """

    def __init__(self, text: str, place: str = "") -> None:
        super().__init__(f"{place}: {text}" if place else text)
        self.what = text
        self.path = [int(i) if i else name for name, i in _PLACE.findall(place)]


def find_type(name: str, kind: str) -> Any:
    """Return the class of `package/kind/Name`. Raises UnfitError."""
    package, _, rest = name.partition("/")
    middle, _, short = rest.partition("/")
    if middle != kind:
        raise UnfitError(f"{name}: a type with /{kind}/ is expected, e.g. {package}/{kind}/Name")
    try:
        module = importlib.import_module(f"{package}.{kind}")
    except ImportError as error:
        if error.name not in (package, f"{package}.{kind}"):
            raise UnfitError(f"{name}: {error}") from None
        text = f"{name}: this Python has no {package}.{kind}"
        raise UnfitError(f"{text}; source the workspace that has it (`setup`)") from None
    found = getattr(module, short, None)
    if not isinstance(found, type):
        # Types generated along with a type have its name plus an underscore.
        known = [k for k, v in vars(module).items() if isinstance(v, type) and "_" not in k]
        raise UnfitError(f"{package} has no {kind} {short}{_nearest(short, known)}")
    return found


def fill(message: Any, data: Any, place: str = "", has_open: bool = False) -> None:
    """Set the fields of a message that `data` names. Raises UnfitError.

    `has_open`: a text with $ may become any value once the arguments of a task are known.
    """
    types = message.get_fields_and_field_types()
    if not isinstance(data, dict):
        text = f"fields are expected ({', '.join(types)}), not {data!r:.60}"
        raise UnfitError(text, place)
    for key, value in data.items():
        here = f"{place}.{key}" if place else str(key)
        if key not in types:
            if key == "yaw" and set(types) == {"x", "y", "z", "w"}:
                if others := sorted(set(data) & set(types)):
                    raise UnfitError(
                        f"give yaw or the quaternion, not both: {', '.join(others)}", here
                    )
                half = _number(value, here, has_open) / 2
                message.z, message.w = math.sin(half), math.cos(half)
                continue
            raise UnfitError(f"there is no field {key!r}{_nearest(key, types)}", here)
        if has_open and is_open(value):
            continue
        made = _made(types[key], value, here, getattr(message, key), has_open)
        try:
            setattr(message, key, made)
        except (AssertionError, TypeError, ValueError) as error:
            # Bounds of texts and lists, and ranges of 32-bit numbers.
            raise UnfitError(f"{error}", here) from None


def is_open(value: Any) -> bool:
    """Return whether a value depends on the arguments of a task."""
    return isinstance(value, str) and "$" in value


def _made(kind: str, value: Any, place: str, default: Any, has_open: bool) -> Any:
    """Convert a value to a ROS type. Raises UnfitError."""
    items = _ITEMS.fullmatch(kind)
    if items is not None:
        if not isinstance(value, list):
            raise UnfitError(f"a list is expected ({kind}), not {value!r:.60}", place)
        if items[3] is not None and len(value) != int(items[3]):
            raise UnfitError(f"{items[3]} values are expected, not {len(value)}", place)
        inner = items[1] or items[2]
        made = [
            _made(inner, item, f"{place}[{i}]", None, has_open)
            for i, item in enumerate(value)
            if not (has_open and is_open(item))
        ]
        return made if len(made) == len(value) else default
    if "/" in kind:
        if kind == TIME and value == "now":
            return default
        nested = default if default is not None else _nested_class(kind)()
        fill(nested, value, place, has_open)
        return nested
    return _scalar(kind, value, place)


def _scalar(kind: str, value: Any, place: str) -> Any:
    whole = _INTEGER.fullmatch(kind)
    if whole is not None or kind in ("byte", "octet", "char"):
        signed = whole is not None and not whole[1]
        bits = int(whole[2]) if whole is not None else 8
        low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if signed else (0, 2**bits - 1)
        number = _number(value, place)
        if number != int(number) or not low <= number <= high:
            raise UnfitError(f"a whole number from {low} to {high} is expected", place)
        return bytes([int(number)]) if kind in ("byte", "octet") else int(number)
    if kind in ("float", "double", "long double"):
        return float(_number(value, place))
    if kind == "boolean":
        if isinstance(value, str) and value in ("true", "false"):
            return value == "true"
        if not isinstance(value, bool):
            raise UnfitError(f"true or false is expected, not {value!r:.60}", place)
        return value
    if _STRING.fullmatch(kind):
        # YAML reads `frame: 1` as a number.
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise UnfitError(f"text is expected, not {value!r:.60}", place)
        return str(value)
    raise UnfitError(f"values of type {kind} cannot be given", place)


def _number(value: Any, place: str, has_open: bool = False) -> float:
    """Read a number, or a text with a number, since arguments of tasks are texts."""
    if has_open and is_open(value):
        return 0
    if not isinstance(value, bool) and isinstance(value, (int, float)):
        return value
    try:
        assert isinstance(value, str)
        return int(value) if re.fullmatch(r"[+-]?\d+", value) else float(value)
    except (AssertionError, ValueError):
        raise UnfitError(f"a number is expected, not {value!r:.60}", place) from None


def stamp_now(message: Any, data: Any, now: Any) -> None:
    """Set the message's time fields that are `now` in `data`."""
    if not isinstance(data, dict):
        return
    types = message.get_fields_and_field_types()
    for key, value in data.items():
        if types.get(key) == TIME and value == "now":
            setattr(message, key, now)
        elif "/" in types.get(key, "") and isinstance(value, dict):
            stamp_now(getattr(message, key), value, now)


def check_field(kind: type, path: str, compared: str = "") -> None:
    """Check that a message class has a field with plain data. Raises UnfitError if not.

    `compared`: the kind of constant that the field is compared with, `a text` or `a number`; empty
    for neither.
    """
    current: Any = kind()
    type_name, done = kind.__name__, ""
    for name, index in _steps(path):
        if name:
            if not hasattr(current, "get_fields_and_field_types"):
                raise UnfitError(f"m.{path}: {done or 'it'} is of type {type_name}: no fields")
            types = current.get_fields_and_field_types()
            if name not in types:
                raise UnfitError(f"m.{path}: there is no field {name!r}{_nearest(name, types)}")
            type_name, done = types[name], f"{done}.{name}" if done else name
            current = getattr(current, name)
        else:
            items = _ITEMS.fullmatch(type_name)
            if items is None:
                raise UnfitError(f"m.{path}: {done or 'it'} is of type {type_name}: no list")
            type_name, done = items[1] or items[2], f"{done}[{index}]"
            current = _nested_class(type_name)() if "/" in type_name else None
    items = _ITEMS.fullmatch(type_name)
    if hasattr(current, "get_fields_and_field_types"):
        names = ", ".join(current.get_fields_and_field_types())
        raise UnfitError(f"m.{path}: is a message; name one of its fields ({names})")
    if items is not None and "/" in (items[1] or items[2]):
        raise UnfitError(f"m.{path}: is a list of messages; name a field of one, e.g. [0]")
    found = "a list" if items else "a text" if _STRING.fullmatch(type_name) else "a number"
    if compared and found != compared:
        raise UnfitError(f"m.{path}: is {found} ({type_name}), and is compared with {compared}")


def read_field(message: Any, path: str) -> Any:
    """Return a field as plain data; None if a list is too short for the path's index.

    Lists are truncated after 2,000 items.
    """
    value = message
    for name, index in _steps(path):
        if name:
            value = getattr(value, name)
        else:
            try:
                value = value[int(index)]
            except IndexError:
                return None
    return _plain(value)


def _plain(value: Any) -> Any:
    if isinstance(value, (bool, int, str)) or value is None:
        return value
    if isinstance(value, float):
        return value
    if isinstance(value, bytes):
        return int.from_bytes(value, "big") if len(value) == 1 else list(value[:MAX_ITEMS])
    if hasattr(value, "item") and not hasattr(value, "__len__"):
        return value.item()
    return [_plain(item) for item in value[:MAX_ITEMS]]


def reason_of(message: Any) -> str:
    """Return the reason of a failure from the usual fields of a result; may be empty."""
    types = message.get_fields_and_field_types()
    said = {name: getattr(message, name) for name in REASONS if name in types}
    texts = [value for value in said.values() if isinstance(value, str) and value]
    code = said.get("error_code")
    code = getattr(code, "val", code)
    if isinstance(code, int) and not isinstance(code, bool) and code != 0:
        texts.append(f"error code {code}")
    return ", ".join(texts)


def _steps(path: str) -> list[tuple[str, str]]:
    return [(step[1] or "", step[2] or "") for step in _STEP.finditer(path)]


def _nested_class(kind: str) -> Any:
    package, _, name = kind.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


def _nearest(name: str, known: Any) -> str:
    names = sorted(known)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f"; did you mean {close[0]!r}?"
    return f"; known: {', '.join(names[:12])}" if names else "; it has none"
