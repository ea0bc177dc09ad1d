"""Facts that follow from others, as long as nothing but their author's word speaks for them.

One robot may lie about what follows: that a job is due, that a task has failed for good, that a
revision is in force. So such a fact is not taken in until this robot's own facts show it, or a
second robot holds it: an honest robot holds, and passes on, only what it believes. Its causes may
have been dropped by then, which is why others are believed at all. Where only one other robot is
heard, nobody else can confirm anything, and what that robot holds counts after some time. What a
robot wrote that is not heard any more does not: its key may have been used for a moment only.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.derived import says
from mrbt_mesh.core.facts.store import Entry, join

# Of each author; beyond that its oldest are forgotten, and pulled again.
MAX_UNPROVED = 256


@dataclass(slots=True)
class _Claim:
    """One entry, the robots that hold it, and since when only one robot is heard, which is among
    them; `since_us` None: others are heard, or nobody.
    """

    entry: Entry
    holders: set[str] = field(default_factory=set)
    since_us: int | None = None


class Unproved:
    """The entries that wait. `changes` grows with each new one, and each new holder of one."""

    def __init__(self, patience_us: int) -> None:
        self.changes = 0
        self._patience_us = patience_us
        # Name -> author -> its entry.
        self._claims: dict[str, dict[str, _Claim]] = {}
        # Author -> the names of its entries.
        self._names: dict[str, dict[str, None]] = {}

    @property
    def names(self) -> Collection[str]:
        """The names of the facts that somebody has written."""
        return self._claims.keys()

    def __bool__(self) -> bool:
        return bool(self._claims)

    def add(self, entry: Entry, holder: str) -> bool:
        """An entry came from a robot; whether two robots say so, and it is to be taken in."""
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
        """Those that are to be taken in now; `heard`: the other robots that are."""
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
        """When one may have to be taken in without proof."""
        self._look(heard, now_us)
        since_us = [c.since_us for c in self._all() if c.since_us is not None]
        return min(since_us) + self._patience_us if since_us else None

    def _look(self, heard: Collection[str], now_us: int) -> None:
        """Note which of them nobody else could confirm, and since when."""
        for claim in self._all():
            if len(heard) != 1 or not claim.holders.issuperset(heard):
                claim.since_us = None
            elif claim.since_us is None:
                claim.since_us = now_us

    def _all(self) -> list[_Claim]:
        return [claim for same in self._claims.values() for claim in same.values()]
