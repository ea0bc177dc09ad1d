"""Side constraints that a mission declares: robots that may not work together, or at once.

`limits` applies them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

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


def constraint_to_json(constraint: Constraint) -> list[Any]:
    """Return [kind, names, local tasks or a number]."""
    match constraint:
        case NeverTogether(robots, local_tasks):
            return ["never_together", list(robots), list(local_tasks)]
        case AtMost(robots, count):
            return ["at_most", list(robots), count]
        case NotAtOnce(global_tasks, count):
            return ["not_at_once", list(global_tasks), count]


def constraint_from_json(data: list[Any]) -> Constraint:
    """Return the constraint; raises KeyError, TypeError or ValueError for any other data."""
    kind, names, rest = data
    if not all(isinstance(name, str) for name in names):
        raise ValueError(f"constraint {kind!r}: names expected")
    if kind == "never_together":
        if not all(isinstance(name, str) for name in rest):
            raise ValueError(f"constraint {kind!r}: names of local tasks expected")
        return NeverTogether(tuple(names), tuple(rest))
    if type(rest) is not int or rest < 1:
        raise ValueError(f"constraint {kind!r}: a number from 1 expected, found {rest!r}")
    if kind == "at_most":
        return AtMost(tuple(names), rest)
    if kind == "not_at_once":
        return NotAtOnce(tuple(names), rest)
    raise ValueError(f"no constraint is called {kind!r}")
