"""The revisions of the mission, as all robots read them from the facts.

An operator proposes a mission under the next number. Every robot writes whether it holds it, and
from then on begins nothing. Once all do, it is in force, which is a fact as well. A proposal that a
robot refuses, or of which two were made at once, is void: the next one has another number.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    AdoptedMission,
    HeldMission,
    OperatorCommand,
    ProposedMission,
)
from mrbt_mesh.core.facts.stamps import second_greatest
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission

_NONE = HeldMission(0, "", "", 0)
# Of numbers of revisions.
MAX_DIGITS = 9


@lru_cache(maxsize=16)
def read_mission(text: str) -> Mission:
    """A compiled mission; raises FileError. Robots that are simulated read the same ones."""
    return mission_from_compiled(text, "revision")


class Revisions:
    """What is said about revisions of one mission."""

    def __init__(self) -> None:
        # (number, author) -> what was proposed.
        self._proposed: dict[tuple[int, str], ProposedMission] = {}
        self._proposers: dict[int, str] = {}
        self._adopted: dict[tuple[int, str], str] = {}
        self._withdrawn: set[tuple[int, str]] = set()
        self._held: dict[str, HeldMission] = {}

    def add(self, entry: Entry) -> None:
        """Take in a fact about a revision."""
        match entry.record:
            case OperatorCommand(ProposedMission() as proposed):
                self._proposed[_key(entry)] = proposed
                self._proposers[_key(entry)[0]] = entry.record.operator
            case HeldMission():
                self._held[entry.author] = entry.record
            case AdoptedMission(digest):
                self._adopted[_key(entry)] = digest
            case _:
                self._withdrawn.add(_key(entry))

    def remove(self, entry: Entry) -> None:
        """A fact about an earlier revision was dropped."""
        key = _key(entry)
        self._proposed.pop(key, None)
        self._adopted.pop(key, None)
        self._withdrawn.discard(key)

    @property
    def last_number(self) -> int:
        """The greatest number that any revision has; 0: there is none.

        It is one that was proposed, or that two robots know of: one alone may lie.
        """
        known = {robot: max(each.number, each.in_force) for robot, each in self._held.items()}
        for number, author in (*self._adopted, *self._withdrawn):
            known[author] = max(number, known.get(author, 0))
        proposed = max((number for number, _ in self._proposed), default=0)
        return max(proposed, second_greatest(known.values()))

    def proposed(self, number: int) -> ProposedMission | None:
        """What is proposed under this number, None if nothing is known of it."""
        return self._proposed.get((number, records.OPERATORS))

    def proposer(self, number: int) -> str:
        """The operator who has proposed this revision; empty if nothing is known of it."""
        return self._proposers.get(number, "")

    def held_by(self, robot: str) -> HeldMission:
        """Which revision a robot holds, and by which it acts."""
        return self._held.get(robot, _NONE)

    def adopted(self, after: int) -> Mission | None:
        """The newest revision that was adopted and is known here, None if none is after `after`."""
        digests = {(number, digest) for (number, _), digest in self._adopted.items()}
        known = ((n, read_mission(p.text)) for (n, _), p in self._proposed.items() if n > after)
        found = [m for n, m in known if (n, m.digest) in digests]
        return max(found, key=lambda m: (m.revision_number, m.digest), default=None)

    def pending(self, in_force: int) -> tuple[ProposedMission, Mission] | None:
        """The proposal that waits until all robots hold it, None if there is none."""
        if (number := self.last_number) <= in_force or self.void_reason(number):
            return None
        proposed = self.proposed(number)
        if proposed is None or any(n == number for n, _ in self._adopted):
            return None
        return proposed, read_mission(proposed.text)

    def void_reason(self, number: int) -> str:
        """Why a proposal cannot be adopted any more; empty if it can."""
        if any(each == number for each, _ in self._withdrawn):
            return "it was withdrawn"
        held = {robot: each for robot, each in self._held.items() if each.number == number}
        for robot in sorted(held):
            if held[robot].problem:
                return f"{robot}: {held[robot].problem}"
        if len({each.digest for each in held.values()}) > 1:
            return "two revisions were proposed at the same time; propose one of them again"
        return ""

    def is_held_by_all(self, mission: Mission, robots: Collection[str]) -> bool:
        """Whether all these robots hold this revision."""
        wanted = mission.revision_number, mission.digest
        held = map(self.held_by, robots)
        return all((each.number, each.digest) == wanted and not each.problem for each in held)

    def awaited(self, number: int, in_force: int, robots: Collection[str]) -> list[str]:
        """The robots that have to hold this revision first, or to act by it; sorted."""
        held = ((robot, self.held_by(robot)) for robot in sorted(robots))
        is_in_force = in_force >= number
        return [r for r, each in held if (each.in_force if is_in_force else each.number) < number]

    def all_act_by(self, number: int, robots: Collection[str]) -> bool:
        """Whether all these robots act by this revision, or a later one."""
        return all(self.held_by(robot).in_force >= number for robot in robots)

    def obsolete(self, in_force: int) -> list[tuple[str, str]]:
        """(author, name) of what is said about earlier revisions."""
        if not in_force:
            return []
        kinds: dict[str, Collection[tuple[int, str]]] = {
            records.MISSION: self._proposed,
            records.MISSION_ADOPTED: self._adopted,
            records.MISSION_WITHDRAWN: self._withdrawn,
        }
        return [
            (author, f"{kind}/{number}")
            for kind, known in kinds.items()
            for number, author in known
            if number < in_force
        ]


def _key(entry: Entry) -> tuple[int, str]:
    return int(entry.parts[1]), entry.author
