"""Facts that follow from others, while only their author vouches for them.

One robot may lie about a consequence: that a job is due, that a task has failed for good, that a
revision is in force. So such a fact is not merged until this robot's own facts show it, or a second
robot holds it: an honest robot holds, and passes on, only what it believes. Its causes may have
been dropped by then, which is why other robots are believed at all. Where only one other robot is
heard, nobody else can confirm anything, and what that robot holds counts after some time. Facts of
a robot that is no longer heard do not: its key may have been misused for just a moment.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.derived import says
from mrbt_mesh.core.facts.store import Entry, join

# Per author; beyond that the oldest entries are dropped, and pulled again later.
MAX_UNPROVED = 256


@dataclass(slots=True)
class _Claim:
    """One entry and the robots that hold it.

    `since_us`: since when only one robot is heard and that one holds the entry; None if other
    robots are heard, or none.
    """

    entry: Entry
    holders: set[str] = field(default_factory=set)
    since_us: int | None = None


class Unproved:
    """The entries that wait for proof. `changes` grows with each new entry or new holder of one."""

    def __init__(self, patience_us: int) -> None:
        self.changes = 0
        self._patience_us = patience_us
        # Name -> author -> the claim with its entry.
        self._claims: dict[str, dict[str, _Claim]] = {}
        # Author -> the names of its entries.
        self._names: dict[str, dict[str, None]] = {}

    @property
    def names(self) -> Collection[str]:
        """The names of the waiting facts."""
        return self._claims.keys()

    def __bool__(self) -> bool:
        return bool(self._claims)

    def add(self, entry: Entry, holder: str) -> bool:
        """Add an entry received from `holder`. Returns True if two robots hold it, so it can be
        merged.
        """
        same = self._claims.setdefault(entry.name, {})
        claim = same.get(entry.author)
        is_news = claim is None or (
            entry.hash != claim.entry.hash and join(claim.entry, entry) is entry
        )
        if claim is None or is_news:
            claim = same[entry.author] = _Claim(entry)
            self._names.setdefault(entry.author, {})[entry.name] = None
        before = len(claim.holders)
        if entry.hash == claim.entry.hash:
            claim.holders |= {entry.author, holder} - {""}
        self.changes += len(claim.holders) > before
        agree = (c.holders for c in same.values() if says(c.entry.record, entry.record))
        if len(set().union(*agree)) > 1:
            self._drop(entry)
            return True
        names = self._names[entry.author]
        if len(names) > MAX_UNPROVED:
            self._drop(self._claims[next(iter(names))][entry.author].entry)
        return False

    def _drop(self, entry: Entry) -> None:
        same = self._claims[entry.name]
        del same[entry.author]
        del self._names[entry.author][entry.name]
        if not same:
            del self._claims[entry.name]

    def take(
        self, is_shown: Callable[[Entry], bool], heard: Collection[str], now_us: int
    ) -> list[Entry]:
        """Remove and return the entries to merge now. `heard`: the other robots that are heard."""
        self._look(heard, now_us)
        found = []
        for claim in self._all():
            waits_us = None if claim.since_us is None else now_us - claim.since_us
            is_unopposed = waits_us is not None and waits_us >= self._patience_us
            if is_unopposed or is_shown(claim.entry):
                self._drop(claim.entry)
                found.append(claim.entry)
        return found

    def next_us(self, heard: Collection[str], now_us: int) -> int | None:
        """When an entry may have to be merged without proof; None if there is none."""
        self._look(heard, now_us)
        since_us = [c.since_us for c in self._all() if c.since_us is not None]
        return min(since_us) + self._patience_us if since_us else None

    def _look(self, heard: Collection[str], now_us: int) -> None:
        """Note since when each entry could not be confirmed by any further robot."""
        for claim in self._all():
            if len(heard) != 1 or not claim.holders.issuperset(heard):
                claim.since_us = None
            elif claim.since_us is None:
                claim.since_us = now_us

    def _all(self) -> list[_Claim]:
        return [claim for same in self._claims.values() for claim in same.values()]
