"""The names of robots, tasks and conditions, and ground names such as `replace_hw(2)`."""

from __future__ import annotations

import re
from collections.abc import Mapping

MAX_NAME = 64
NAME_PATTERN = rf"[A-Za-z_][A-Za-z0-9_]{{0,{MAX_NAME - 1}}}"
ARGUMENT_PATTERN = r"[A-Za-z0-9_.+-]{1,64}"
ROBOT_PATTERN = r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}"
MAX_ARGUMENTS = 8
# In place of a parameter, until a job gives it a value; no ground name has it.
PLACEHOLDER = re.compile(r"\{(\w+)\}")
# In place of a local task: all that a robot has.
ALL = "all"
_OF = "@"

_CALL = re.compile(rf"({NAME_PATTERN})(?:\(({ARGUMENT_PATTERN}(?:,{ARGUMENT_PATTERN})*)\))?")
_ROBOT = re.compile(ROBOT_PATTERN)


def split_call(text: str) -> tuple[str, tuple[str, ...]]:
    """`replace_hw(2)` -> ("replace_hw", ("2",)); raises ValueError if it is not ground."""
    match = _CALL.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a name like fix_hw or fix_hw(2)")
    arguments = tuple(match[2].split(",")) if match[2] else ()
    if len(arguments) > MAX_ARGUMENTS:
        raise ValueError(f"{text!r} has more than {MAX_ARGUMENTS} arguments")
    return match[1], arguments


def placeholder(parameter: str) -> str:
    """What is in the place of a parameter until a job gives it a value."""
    return f"{{{parameter}}}"


def bound(text: str, values: Mapping[str, str]) -> str:
    """A text with the values in the places of its parameters."""
    if "{" not in text:
        return text
    return PLACEHOLDER.sub(lambda match: values.get(match[1], match[0]), text)


def type_name(ground: str) -> str:
    """The type of a ground name: `replace_hw(2)` -> `replace_hw`."""
    return ground.partition("(")[0]


def robot_condition(condition: str, robot: str) -> str:
    """The condition of one robot: `holding(1)@A1`."""
    return f"{condition}{_OF}{robot}"


def split_owner(name: str) -> tuple[str, str]:
    """`holding@A1` -> ("holding", "A1"); for a condition of the team the robot is empty."""
    condition, _, robot = name.partition(_OF)
    return condition, robot


def is_robot_id(text: str) -> bool:
    """Whether `text` may name a robot: 1 to 32 letters, digits, `_`, `-`."""
    return _ROBOT.fullmatch(text) is not None
