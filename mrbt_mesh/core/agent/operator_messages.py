"""What an operator's client and a robot send each other: words, steps of commands, refusals.

A client needs nothing else of a robot, so this module imports no parts of the agent.
"""

from __future__ import annotations

import enum
from typing import Any

from mrbt_mesh.core.facts.store import Entry, Incarnation, Version

# Words to one robot, whose effects end with its process.
FAULT, RESTORE, LEAVE, PERFORM = "fault", "restore", "leave", "perform"
REFUSALS = "refusals"
# A command that becomes a fact of its operator.
OPERATE = "operate"

# Why a command is refused. UNKNOWN: there is no such subject. CONFLICT: the field has another value
# for good. FULL: there are too many. ENDED: it is too late. OUT_OF_RANGE: a time is too far away or
# has passed, so the command was, or will be, valid at another time.
INVALID, UNKNOWN, CONFLICT, FULL, ENDED = "invalid", "unknown", "conflict", "full", "ended"
OUT_OF_RANGE = "out_of_range"
# Another robot may take it, or this one in a moment; another client has reserved the field.
NOT_READY, CONTENDED = "not_ready", "contended"


class CommandStep(enum.StrEnum):
    """What a client asks of a robot: to CHECK whether it would take a command, and to reserve its
    field if that is commanded once; to WRITE the command; or to GIVE_UP what was reserved.
    """

    CHECK = "check"
    WRITE = "write"
    GIVE_UP = "give_up"


def command_body(command: str, argument: Any = "") -> list[Any]:
    """A command as plain data."""
    return [command, argument]


def operate_body(step: CommandStep, entry: Entry, passes_on: bool = True) -> list[Any]:
    """A client's request to a robot as plain data.

    `passes_on`: the robot passes the command on to the others at once. Otherwise robots that lack
    it pull it.
    """
    (stamp, command_id), _ = entry.version
    return [str(step), entry.name, stamp, command_id, entry.value, passes_on]


def command_version(stamp: int, command_id: str) -> Version:
    """The version of a command's entry."""
    return Version(Incarnation(stamp, command_id), 0)
