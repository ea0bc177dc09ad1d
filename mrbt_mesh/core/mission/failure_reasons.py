"""Failure reasons, which robots' programs give, and conditions that follow from them.

A reason is one line of text, kept with the outcome. Only a condition that is declared with
`failure_reason` reads it: it is true while the last outcome of its task is a failure with a
matching reason. The robot writes it together with its outcome, so for the team it is a condition
like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mrbt_mesh.core.mission.names import split_call

MAX_REASON = 200
_CUT = "…"
_PARAMETER = "$"
# The task is a global one or a local one; the reason equals the text or contains it.
GLOBAL, LOCAL = "global_task", "local_task"
EQUALS, CONTAINS = "equals", "contains"


def one_line(text: str) -> str:
    """A reason as it is kept: one line of limited length, without unprintable characters."""
    line = " ".join(text.split())
    line = "".join(sign if sign.isprintable() else "?" for sign in line)
    return line if len(line) <= MAX_REASON else line[: MAX_REASON - 1] + _CUT


@dataclass(frozen=True, slots=True)
class FailureReason:
    """Makes a condition true: a failure of this task, with a matching reason.

    `kind`: GLOBAL or LOCAL. `task`: its type. `arguments`: each a text, or `$name` for a parameter
    of the condition. `match`: EQUALS or CONTAINS.
    """

    kind: str
    task: str
    arguments: tuple[str, ...]
    match: str
    text: str

    def fits(self, reason: str) -> bool:
        """Whether a reason matches."""
        return reason == self.text if self.match == EQUALS else self.text in reason

    def bind(
        self, parameters: Sequence[str], global_task: str, local_task: str
    ) -> tuple[str, ...] | None:
        """The arguments of the condition that an outcome of this work sets, None if it sets none.

        `parameters`: those of the condition, each of which is among the arguments.
        """
        name, arguments = split_call(global_task if self.kind == GLOBAL else local_task)
        if name != self.task or len(arguments) != len(self.arguments):
            return None
        bound: dict[str, str] = {}
        for expected, found in zip(self.arguments, arguments, strict=True):
            if expected.startswith(_PARAMETER):
                if bound.setdefault(expected[1:], found) != found:
                    return None
            elif expected != found:
                return None
        return tuple(bound[parameter] for parameter in parameters)
