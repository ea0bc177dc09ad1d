"""*Check Consistency* for one plan after the other: what has not changed is not decided again."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.consistency.bitsets import RobotBitset
from mrbt_mesh.core.incremental.consistency.kept_requests import (
    Groups,
    KeptRequests,
    SharedPinError,
)
from mrbt_mesh.core.incremental.consistency.matching import Matching
from mrbt_mesh.core.incremental.consistency.slots import Row
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.consistency import Kept, is_better, kept_requests
from mrbt_mesh.core.planning.demands import Demand


class BitsetConsistency:
    """`planning.consistency.Consistency` on bit masks."""

    def __init__(self, free: Iterable[str]) -> None:
        self._bits = RobotBitset(sorted(free))
        self._matching = Matching(self._bits.all)

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        self._bind(pinned)
        return self._matching.decide(self._row(key, demands, pinned))

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        self._bind(pinned)
        row = self._row(key, demands, pinned)
        fits = self._matching.fits(row)
        self._matching.remove_row(row)
        return fits

    @property
    def matched(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        found = self._matching.matched()
        return {robot: found[bit] for robot, bit in self._bits.joined if bit in found}

    def _bind(self, pinned: Collection[str]) -> None:
        """These robots are not free."""
        free = self._bits.all & ~self._bits.of(pinned) if pinned else self._bits.all
        if free != self._matching.free:
            self._matching.set_free(free)

    def _row(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> Row:
        row = Row(len(self._matching.rows), key)
        asks = []
        for demand in demands:
            own = sum(1 for robot in demand.pinned if pinned.get(robot) == key)
            asks.append((self._bits.mask(demand.candidates), max(0, demand.lower - own)))
        self._matching.add_row(row, asks)
        return row


class ConsistencyKeeper:
    """*Check Consistency* for one plan after the other: what has not changed is not done again.

    Groups of demands, and candidates, that are the same objects as before must not have changed.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._bits = RobotBitset()
        self._requests = KeptRequests(self._bits)

    def kept_requests(
        self,
        facts: TeamFacts,
        demands: Groups,
        team: Mapping[str, Worker],
        excluded: Collection[int] = (),
    ) -> Kept:
        """As the function `kept_requests`; the pins are sorted by robot."""
        self._bits.set(team)
        if self._bits.count > 2 * len(team) + 64:
            self._forget()
            self._bits.set(team)
        try:
            found = self._plain(facts, demands, excluded)
        except SharedPinError:
            self._forget()
            found = None
        if found is None:
            return kept_requests(facts, demands, lambda: BitsetConsistency(team), excluded)
        return found

    def _plain(self, facts: TeamFacts, demands: Groups, excluded: Collection[int]) -> Kept | None:
        """None if a request might take robots from others."""
        requests = self._requests
        requests.update(demands, excluded, frozenset())
        if _might_preempt(facts, requests):
            return None
        kept, pins = requests.kept, requests.pins
        futile = frozenset(robot for robot, row in pins.items() if not row.kept)
        yielding: set[str] = set()
        if futile and requests.would_matter(futile):
            requests.update(demands, excluded, futile)
            if _might_preempt(facts, requests):
                return None
            if is_better(requests.kept, kept):
                kept, yielding = requests.kept, set(futile)
                for robot in sorted(futile):  # who helps nobody goes on
                    requests.update(demands, excluded, frozenset(yielding - {robot}))
                    if _might_preempt(facts, requests):
                        return None
                    if requests.kept == kept:
                        yielding.discard(robot)
        return list(kept), {r: pins[r].index for r in sorted(pins) if r not in yielding}


def _might_preempt(facts: TeamFacts, requests: KeptRequests) -> bool:
    """Whether a request that is not kept may take robots from others further right."""
    if not facts.mission.has_preemptive:
        return False
    tasks = facts.mission.global_tasks
    last = max((row.index for row in requests.pins.values()), default=-1)
    return any(
        not row.kept and row.wanted and tasks[row.source[0].request.subject].preemptive
        for row in requests.rows[: last + 1]
    )
