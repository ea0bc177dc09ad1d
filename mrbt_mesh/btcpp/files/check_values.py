"""Checks single values: names, numbers, booleans, statuses, lists, scripts."""

from __future__ import annotations

import json
import re
from collections.abc import Collection

from mrbt_mesh.btcpp.files.builtin_nodes import (
    BOOLEAN,
    INTEGER,
    LIST,
    LOOP_ITEMS,
    REAL,
    SCRIPT,
    STATUS,
    STATUS_NAMES,
    TEXT,
    UNSIGNED,
)
from mrbt_mesh.btcpp.files.document import pointer
from mrbt_mesh.btcpp.scripts.parser import dialect_problem, parse
from mrbt_mesh.btcpp.scripts.script import Impossible, ScriptError
from mrbt_mesh.btcpp.scripts.values import (
    INTEGERS,
    REALS,
    is_in_range,
    leading_real,
    list_item,
    read_boolean,
    split_items,
)
from mrbt_mesh.errors import MAX_SHOWN_CHARACTERS, nearest

FORBIDDEN = " \t\n<>&\"'/\\:*?|."
MAX_HINT_NAMES = 500
RESERVED_NAMES = ("Root", "root")
RESERVED_PORTS = ("name", "ID", "_autoremap")

# As in BehaviorTree.CPP, only the leading integer is read: `1.5` as 1.
_INTEGER = re.compile(r"([+-]?[0-9]+).*", re.ASCII | re.DOTALL)
_UNSIGNED = re.compile(r"(\+?[0-9]+).*", re.ASCII | re.DOTALL)
_LIMITS = {INTEGER: (-(2**31), 2**31 - 1), UNSIGNED: (0, 2**32 - 1)}
_REAL = re.compile(r"[+-]?([0-9]|\.[0-9]|inf|nan).*", re.ASCII | re.DOTALL | re.IGNORECASE)


def shown(text: str) -> str:
    """Return a value quoted for a message, shortened if it is long."""
    return repr(text if len(text) <= MAX_SHOWN_CHARACTERS else text[:MAX_SHOWN_CHARACTERS] + "...")


def hint(name: str, known: Collection[str]) -> str:
    """Return `nearest(name, known)`, or "" if there are too many names to search."""
    return nearest(name, known) if len(known) <= MAX_HINT_NAMES else ""


def name_problem(name: str) -> str:
    """Return why BehaviorTree.CPP 4.8.4 and later refuse a name of a model, tree or port, or ""."""
    if name in RESERVED_NAMES:
        return f"{name!r} is a reserved name"
    for character in name:
        if character in FORBIDDEN or ord(character) < 32 or ord(character) == 127:
            what = "a space" if character == " " else repr(character)
            return f"the name {shown(name)} contains {what}; letters, digits, '_' and '-' are safe"
    return ""


def port_name_problem(name: str) -> str:
    """Return the problem with the name of a port in a model; empty if there is none."""
    if name in RESERVED_PORTS:
        return f"{name!r} is reserved and cannot name a port"
    if name[:1].isdigit():
        return f"the port name {name!r} begins with a digit"
    return name_problem(name)


def value_problem(node: str, kind: str, value: str) -> str:
    """Return the problem with a constant of a built-in node's port of type `kind`, or ""."""
    trimmed = value.strip()
    if kind == INTEGER and not _INTEGER.fullmatch(trimmed):
        return f"{shown(value)} is not a whole number"
    if kind == UNSIGNED and not _UNSIGNED.fullmatch(trimmed):
        return f"{shown(value)} is not a whole number of 0 or more"
    if kind == REAL and not _REAL.fullmatch(trimmed):
        return f"{shown(value)} is not a number"
    if kind == BOOLEAN and read_boolean(trimmed) is None:
        return f"{shown(value)} is not a boolean; write true or false"
    if kind == SCRIPT:
        return script_problem(value)
    if kind == LIST:
        return _list_problem(LOOP_ITEMS[node], trimmed)
    return ""


def typing_problem(kind: str, value: str) -> tuple[str, bool]:
    """Return what is odd about a readable value, and whether BehaviorTree.CPP refuses it."""
    is_typed = kind in (INTEGER, UNSIGNED, BOOLEAN, REAL, LIST)
    if kind == LIST and value.strip().startswith("json:"):
        return f"{shown(value)}: BehaviorTree.CPP takes no JSON here; write items with ';'", True
    if not is_constant(value, "port"):
        is_odd = is_typed and (value == "=" or value != value.strip())
        return ("BehaviorTree.CPP takes only {name} or {=} here" if is_odd else ""), is_odd
    if kind == SCRIPT:
        problem = dialect_problem(value) or running_problem(value)
        return problem, bool(problem)
    if kind == STATUS:
        is_odd = value not in STATUS_NAMES
        problem = f"{shown(value)} is not a status; write SUCCESS, FAILURE or SKIPPED"
        return (problem if is_odd else ""), is_odd
    if kind in (INTEGER, UNSIGNED, BOOLEAN, REAL) and value[:1].isspace():
        return f"{shown(value)} begins with a space, which BehaviorTree.CPP does not take", True
    if kind == REAL and value.startswith("+"):
        return f"{shown(value)} begins with '+', which BehaviorTree.CPP does not take", True
    if kind not in _LIMITS:
        return "", False
    found = (_INTEGER if kind == INTEGER else _UNSIGNED).fullmatch(value.strip())
    if found is None or (found[1] == value.strip() and not value.startswith("+")):
        number = int(found[1]) if found else 0
        least, most = _LIMITS[kind]
        is_out = not least <= number <= most
        return (f"{shown(value)} is not from {least} to {most}", True) if is_out else ("", False)
    if value.startswith("+"):
        return f"{shown(value)} begins with '+', which BehaviorTree.CPP does not take", True
    return f"{shown(value)} is not a whole number; BehaviorTree.CPP reads it as {found[1]}", False


def conversion_problem(kind: str, text: str) -> str:
    """Return why BehaviorTree.CPP cannot convert a text to a canonical type; "" if it can.

    Unknown types are not checked. A number may be followed by any text.
    """
    if (item := list_item(kind)) is not None:
        if text.startswith("json:"):
            return (
                ""
                if _is_json_list(item, text[5:])
                else f"{shown(text)} is not a JSON list of {item}"
            )
        problems = (conversion_problem(item, each) for each in split_items(text))
        return next(filter(None, problems), "")
    if kind in INTEGERS:
        sign = "" if kind == "uint64_t" else "-?"
        number = re.match(f"{sign}[0-9]+", text, re.ASCII)
        if number is None:
            return f"{shown(text)} is not a whole number"
        return "" if is_in_range(int(number[0]), kind) else f"{shown(text)} is not of type {kind}"
    if kind in REALS and leading_real(text) is None:
        return f"{shown(text)} is not a number"
    if kind == BOOLEAN and read_boolean(text) is None:
        return f"{shown(text)} is not a boolean; write true or false"
    return ""


_JSON_ITEMS: dict[str, tuple[type, ...]] = {BOOLEAN: (bool,), TEXT: (str,)}


def _is_json_list(item: str, text: str) -> bool:
    try:
        items = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(items, list):
        return False
    if item in _JSON_ITEMS:
        return all(isinstance(each, _JSON_ITEMS[item]) for each in items)
    if item not in INTEGERS and item not in REALS:
        return True
    # Here BehaviorTree.CPP takes a boolean as an integer, but not as a real number.
    is_number = all(isinstance(each, int | float) for each in items)
    return is_number and (item in INTEGERS or not any(isinstance(each, bool) for each in items))


def _list_problem(item_kind: str, text: str) -> str:
    if text.startswith("json:"):
        try:
            items = json.loads(text[5:])
        except (ValueError, RecursionError):
            return f"{shown(text)} is not JSON after 'json:'"
        return "" if isinstance(items, list) else f"{shown(text)} is not a JSON list"
    if item_kind == TEXT:
        return ""
    for item in split_items(text):
        odd, is_refused = typing_problem(item_kind, item.strip())
        if problem := value_problem("", item_kind, item) or (odd if is_refused else ""):
            return f"{problem}; items are separated by ';'"
    return ""


def script_problem(text: str) -> str:
    """Return the problem with a script; empty if it can be parsed."""
    try:
        parse(text)
    except ScriptError as error:
        return f"the script {shown(text)} cannot be read: {error}"
    return ""


def running_problem(text: str) -> str:
    """Return why a script that can be parsed always fails when it is run, or ""."""
    for expression in parse(text).expressions():
        if isinstance(expression, Impossible):
            return (
                f"the script {shown(text)} cannot be run: only a blackboard entry can stand "
                f"before {expression.operator!r}"
            )
    return ""


def is_constant(value: str, attribute: str) -> bool:
    """Return whether a port's value is a constant, not a blackboard entry."""
    return pointer(value, attribute) is None
