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
# In place of a job's id, as `PLACEHOLDER`; no parameter has such a name.
THIS_JOB = "0"
_OF = "@"
_OF_JOB = "job:"

_VALUE = rf"(?:{ARGUMENT_PATTERN}|\${NAME_PATTERN})"
_CALL = re.compile(rf"({NAME_PATTERN})(?:\(({_VALUE}(?:,{_VALUE})*)\))?")
_READ = re.compile(rf"\$({NAME_PATTERN})")
_ROBOT = re.compile(ROBOT_PATTERN)
_ARGUMENT = _JOB_ID = re.compile(ARGUMENT_PATTERN)


def split_call(text: str) -> tuple[str, tuple[str, ...]]:
    """`replace_hw(2)` -> ("replace_hw", ("2",)); raises ValueError if it is not ground.

    An argument may be read from the team's blackboard: `fetch($found)`.
    """
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


def entries_in(call: str) -> list[str]:
    """The blackboard entries that are arguments of a call: `fetch($found,2)` -> ["found"]."""
    return _READ.findall(call) if "$" in call else []


def with_entries(call: str, values: Mapping[str, str]) -> str:
    """A call with the values of entries as arguments: `fetch($found)` -> `fetch(red)`."""
    return _READ.sub(lambda match: values.get(match[1], match[0]), call)


def robot_condition(condition: str, robot: str) -> str:
    """The condition of one robot: `holding(1)@A1`, `battery@A1 < 30`."""
    name, blank, rest = condition.partition(" ")
    return f"{name}{_OF}{robot}{blank}{rest}"


def job_entry(condition: str, job: str) -> str:
    """The entry of one job: `found@job:morning-1`."""
    return robot_condition(condition, f"{_OF_JOB}{job}")


def split_owner(name: str) -> tuple[str, str]:
    """`holding@A1` -> ("holding", "A1"), `battery@A1 < 30` -> ("battery < 30", "A1"); the owner of
    what is of the team is empty.
    """
    if _OF not in name:
        return name, ""
    name, blank, rest = name.partition(" ")
    condition, _, owner = name.partition(_OF)
    return f"{condition}{blank}{rest}", owner


def owning_job(name: str) -> str:
    """The job to which an entry, or a comparison of it, belongs; empty: to none."""
    owner = split_owner(name)[1]
    return owner[len(_OF_JOB) :] if owner.startswith(_OF_JOB) else ""


def declared_name(condition: str) -> str:
    """The declared condition or entry of a name: `heavy(red)@A1`, `heavy(red) == 3` -> `heavy`."""
    return type_name(condition.partition(" ")[0].partition(_OF)[0])


def name_order(name: str) -> tuple[tuple[bool, int, str], ...]:
    """A key that sorts names as people do: C2 before C10."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts)


def is_argument(text: str) -> bool:
    """Whether a text may be an argument of a task."""
    return _ARGUMENT.fullmatch(text) is not None


def is_robot_id(text: str) -> bool:
    """Whether `text` may name a robot: 1 to 32 letters, digits, `_`, `-`."""
    return _ROBOT.fullmatch(text) is not None


def is_job_id(text: str) -> bool:
    """Whether `text` may name a job: 1 to 64 letters, digits, `_`, `.`, `+`, `-`. The two that
    mean places in a path are none.
    """
    return _JOB_ID.fullmatch(text) is not None and text not in (".", "..")
