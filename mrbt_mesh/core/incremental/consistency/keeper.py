"""*Check Consistency* for one plan after the other: what has not changed is not decided again.

In place of `planning.consistency.kept_requests`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.incremental.consistency.decisions import Decisions
from mrbt_mesh.core.incremental.consistency.kept_requests import (
    Groups,
    KeptRequests,
    SharedPinError,
)
from mrbt_mesh.core.incremental.consistency.robot_bits import RobotBits
from mrbt_mesh.core.incremental.consistency.slots import OrderedRequest
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.consistency import (
    Consistency,
    Kept,
    kept_requests,
    with_yielding_pins,
)
from mrbt_mesh.core.planning.demands import Demand

# With fewer requests the definition is faster, with more changes at once starting from scratch:
# benchmarks/consistency.py.
FEW_REQUESTS = 16
REQUESTS_PER_CHANGE = 8


class BitsetConsistency:
    """`planning.consistency.Consistency`, with sets of robots as bits of ints."""

    def __init__(self, free: Iterable[str]) -> None:
        self._bits = RobotBits(sorted(free))
        self._decisions = Decisions(self._bits.all)
        self._pinned: Mapping[str, int] = {}

    def keep(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Try to add request `key`; `pinned` maps robots to the request that they run."""
        return self._decisions.decide(self._request(key, demands, pinned))

    def fits(self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]) -> bool:
        """Whether `keep` would succeed."""
        request = self._request(key, demands, pinned)
        fits = self._decisions.fits(request)
        self._decisions.remove(request)
        return fits

    @property
    def matched(self) -> dict[str, int]:
        """Robot -> the request that it is kept for."""
        found = self._decisions.matching.robots()
        return {robot: found[bit].source for robot, bit in self._bits.joined if bit in found}

    def _request(
        self, key: int, demands: Sequence[Demand], pinned: Mapping[str, int]
    ) -> OrderedRequest:
        if pinned != self._pinned:
            self._pinned = dict(pinned)
            self._decisions.set_free(self._bits.all & ~self._bits.of(pinned))
        request = OrderedRequest(len(self._decisions.requests), key)
        slots = []
        for demand in demands:
            own = sum(1 for robot in demand.pinned if pinned.get(robot) == key)
            slots.append((self._bits.mask(demand.candidates), max(0, demand.lower - own)))
        self._decisions.add(request, slots)
        return request


class _PreemptionError(Exception):
    """A request might take robots from others."""


class ConsistencyKeeper:
    """Answers as `kept_requests`, each time from what was so the last time.

    Groups of demands, and candidates, that are the same objects as before must not have changed.
    """

    def __init__(
        self, few_requests: int = FEW_REQUESTS, requests_per_change: int = REQUESTS_PER_CHANGE
    ) -> None:
        self._few_requests = few_requests
        self._requests_per_change = requests_per_change
        self._forget()

    def _forget(self) -> None:
        self._bits = RobotBits()
        self._requests = KeptRequests(self._bits, self._requests_per_change)

    def kept_requests(
        self,
        facts: TeamFacts,
        demands: Groups,
        team: Mapping[str, Worker],
        excluded: Collection[int] = (),
    ) -> Kept:
        """The indices of the requests that are kept, and the pins that hold, sorted by robot."""
        if len(demands) < self._few_requests:
            return kept_requests(facts, demands, lambda: Consistency(team), excluded)
        self._bits.set(team)
        if self._bits.count > 2 * len(team) + 64:
            self._forget()
            self._bits.set(team)
        try:
            return self._updated(facts, demands, excluded)
        except SharedPinError:
            self._forget()
        except _PreemptionError:
            pass
        return kept_requests(facts, demands, lambda: BitsetConsistency(team), excluded)

    def _updated(self, facts: TeamFacts, demands: Groups, excluded: Collection[int]) -> Kept:
        """Raises SharedPinError, and _PreemptionError, since that is not brought up to date."""
        requests = self._requests
        requests.update(demands, excluded, frozenset())

        def keep(pins: dict[str, int]) -> Kept:
            released = frozenset(requests.pins.keys() - pins.keys())
            if released != requests.released:
                requests.update(demands, excluded, released)
            if _might_preempt(facts, requests):
                raise _PreemptionError
            return list(requests.kept), pins

        pins = {robot: request.index for robot, request in requests.pins.items()}
        return with_yielding_pins(pins, keep)


def _might_preempt(facts: TeamFacts, requests: KeptRequests) -> bool:
    """Whether a request that is not kept may take robots from others further right."""
    if not facts.mission.has_preemptive:
        return False
    tasks = facts.mission.global_tasks
    last = max((request.index for request in requests.pins.values()), default=-1)
    return any(
        not each.kept and not each.excluded and tasks[each.source[0].request.subject].preemptive
        for each in requests.requests[: last + 1]
    )
