"""Side constraints that a mission declares: robots that may not work together, or at once.

`limits` applies them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission


@dataclass(frozen=True, slots=True)
class NeverTogether:
    """r(i, l) r(h, l) = 0: at most one of these robots on the same demand.

    `local_tasks` are ground names or types; empty means all.
    """

    robots: tuple[str, ...]
    local_tasks: tuple[str, ...] = ()

    def __str__(self) -> str:
        where = f"the same {' or '.join(self.local_tasks)}" if self.local_tasks else "the same task"
        return f"only one of {', '.join(self.robots)} on {where}"


@dataclass(frozen=True, slots=True)
class AtMost:
    """At most `count` of these robots are at work at the same time."""

    robots: tuple[str, ...]
    count: int

    def __str__(self) -> str:
        return f"at most {self.count} of {', '.join(self.robots)} at work"


@dataclass(frozen=True, slots=True)
class NotAtOnce:
    """At most `count` requests for these global tasks, ground names or types, have robots."""

    global_tasks: tuple[str, ...]
    count: int

    def __str__(self) -> str:
        return f"at most {self.count} of {', '.join(self.global_tasks)} at once"


Constraint: TypeAlias = NeverTogether | AtMost | NotAtOnce

# The name of the section in a mission and in its file.
SECTION = "constraints"


def constraints_of(mission: Mission) -> tuple[Constraint, ...]:
    """Return the side constraints of a mission."""
    found: tuple[Constraint, ...] = mission.sections.get(SECTION, ())
    return found
