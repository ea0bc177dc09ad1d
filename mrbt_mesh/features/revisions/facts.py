"""The revisions of the mission, as all robots read them from the facts.

An operator proposes a mission under the next number. Every robot writes whether it holds it, and
begins nothing from then on. Once all robots hold it, it is in force, which is a fact as well. A
proposal is void if a robot refuses it or two were made at once: the next one has another number.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import lru_cache

from mrbt_mesh.core.facts.records import OPERATORS, Job, OperatorCommand
from mrbt_mesh.core.facts.stamps import second_greatest
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.feature import Index
from mrbt_mesh.core.mission.compiled import mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError
from mrbt_mesh.features.revisions.kinds import (
    MAX_DIGITS,
    MISSION,
    MISSION_ADOPTED,
    MISSION_WITHDRAWN,
)
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission, ProposedMission

_NONE = HeldMission(0, "", "", 0)


@lru_cache(maxsize=16)
def read_mission(text: str) -> Mission:
    """Parse a compiled mission. Raises FileError. Cached, as simulated robots share missions."""
    return mission_from_compiled(text, "revision")


def misplaced(entry: Entry, mission: Mission) -> str:
    """Why this team has no place for a fact about a revision: it is one of another team's mission,
    or cannot be parsed. Empty: it has.
    """
    parts = entry.parts
    if len(parts) > 1 and not (parts[1].isdecimal() and len(parts[1]) <= MAX_DIGITS):
        return f"{parts[1]!r:.80} is not a number of a revision"
    record = entry.record.value if isinstance(entry.record, OperatorCommand) else None
    if not isinstance(record, ProposedMission):
        return ""
    try:
        found = read_mission(record.text)
    except FileError as error:
        return f"a revision that cannot be read: {error}"
    if found.team_digest != mission.team_digest or found.number != int(parts[1]):
        return f"revision {parts[1]} is one of another mission"
    return ""


class Revisions(Index):
    """The facts about revisions, while one mission of a team is in force.

    `is_used`: there have been such facts, or the mission in force is a revision.
    """

    def __init__(self, mission: Mission) -> None:
        self.is_used = mission.succession is not None
        self._in_force = mission.number
        self._has_news = False
        # (number, author) -> what was proposed.
        self._proposed: dict[tuple[int, str], ProposedMission] = {}
        self._proposers: dict[int, str] = {}
        self._adopted: dict[tuple[int, str], str] = {}
        self._withdrawn: set[tuple[int, str]] = set()
        self._held: dict[str, HeldMission] = {}

    def add(self, entry: Entry) -> None:
        self.is_used = self._has_news = True
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
        key = _key(entry)
        self._proposed.pop(key, None)
        self._adopted.pop(key, None)
        self._withdrawn.discard(key)

    @property
    def last_number(self) -> int:
        """The greatest number of any revision; 0 if there is none.

        It was proposed, or two robots know of it, since one robot alone may lie.
        """
        known = {robot: max(each.number, each.in_force) for robot, each in self._held.items()}
        for number, author in (*self._adopted, *self._withdrawn):
            known[author] = max(number, known.get(author, 0))
        proposed = max((number for number, _ in self._proposed), default=0)
        return max(proposed, second_greatest(known.values()))

    def proposed(self, number: int) -> ProposedMission | None:
        """The proposal under this number, None if it is not known."""
        return self._proposed.get((number, OPERATORS))

    def proposer(self, number: int) -> str:
        """The operator who proposed this revision; empty if it is not known."""
        return self._proposers.get(number, "")

    def held_by(self, robot: str) -> HeldMission:
        """The revision that a robot holds, and the one that it acts by."""
        return self._held.get(robot, _NONE)

    def adopted(self, after: int) -> Mission | None:
        """The newest adopted revision known here, None if none is newer than `after`."""
        digests = {(number, digest) for (number, _), digest in self._adopted.items()}
        known = ((n, read_mission(p.text)) for (n, _), p in self._proposed.items() if n > after)
        found = [m for n, m in known if (n, m.digest) in digests]
        return max(found, key=lambda m: (m.number, m.digest), default=None)

    def pending(self, in_force: int) -> tuple[ProposedMission, Mission] | None:
        """The proposal that waits until all robots hold it, None if there is none."""
        if (number := self.last_number) <= in_force or self.void_reason(number):
            return None
        proposed = self.proposed(number)
        if proposed is None or any(n == number for n, _ in self._adopted):
            return None
        return proposed, read_mission(proposed.text)

    def void_reason(self, number: int) -> str:
        """Why a proposal can no longer be adopted; empty if it can."""
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
        """True if all of these robots hold this revision."""
        wanted = mission.number, mission.digest
        held = map(self.held_by, robots)
        return all((each.number, each.digest) == wanted and not each.problem for each in held)

    def awaited(self, number: int, in_force: int, robots: Collection[str]) -> list[str]:
        """The robots that must still hold this revision, or, once it is in force, act by it;
        sorted.
        """
        held = ((robot, self.held_by(robot)) for robot in sorted(robots))
        is_in_force = in_force >= number
        return [r for r, each in held if (each.in_force if is_in_force else each.number) < number]

    def all_act_by(self, number: int, robots: Collection[str]) -> bool:
        """True if all of these robots act by this revision, or a later one."""
        return all(self.held_by(robot).in_force >= number for robot in robots)

    # -- what the kernel asks -----------------------------------------------------------------

    def successor(self) -> Mission | None:
        if not self._has_news:
            return None
        self._has_news = False
        return self.adopted(self._in_force)

    def objects_to_job(self, job: Job) -> str:
        coming = self.pending(self._in_force)
        if coming is None:
            return ""
        known = coming[1].jobs.get(job.type)
        if known is None:
            return f"a revision without jobs of type {job.type} is about to be in force"
        problem = known.problem(job.arguments)
        return f"a revision is about to be in force in which {problem}" if problem else ""

    def says(self, entry: Entry) -> bool:
        is_adopted = isinstance(entry.record, AdoptedMission)
        return is_adopted and int(entry.parts[1]) < self._in_force

    def shows(self, entry: Entry, alive: Mapping[str, Incarnation]) -> bool:
        assert isinstance(entry.record, AdoptedMission)
        wanted, pending = (int(entry.parts[1]), entry.record.digest), self.pending(self._in_force)
        return (
            pending is not None
            and (pending[1].number, pending[1].digest) == wanted
            and self.is_held_by_all(pending[1], alive)
        )

    def obsolete(self) -> list[tuple[str, str]]:
        if not self._in_force:
            return []
        kinds: dict[str, Collection[tuple[int, str]]] = {
            MISSION: self._proposed,
            MISSION_ADOPTED: self._adopted,
            MISSION_WITHDRAWN: self._withdrawn,
        }
        return [
            (author, f"{kind}/{number}")
            for kind, known in kinds.items()
            for number, author in known
            if number < self._in_force
        ]


def _key(entry: Entry) -> tuple[int, str]:
    return int(entry.parts[1]), entry.author
