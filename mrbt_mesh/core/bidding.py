"""Bids: performances that only the robots know, told once per activation.

Where a need says `performance: bid`, each robot that could be put on it tells one number, as a
fact. The plan waits for the bids of the living, for a short while, and then assigns exactly. One
broadcast per robot takes the place of an auction's rounds.

Who has no bid once nobody is waited for any more counts with the worst performance there is: it
serves where nobody else can. So bids never keep a team from what it can do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from mrbt_mesh.core import records
from mrbt_mesh.core.capable import Worker
from mrbt_mesh.core.demand import Demand
from mrbt_mesh.core.mission import MAX_PERFORMANCE, MICRO, Need
from mrbt_mesh.core.records import Phase
from mrbt_mesh.core.team import TeamFacts

if TYPE_CHECKING:
    from mrbt_mesh.core.plan import Line

# What a robot without a bid counts with: no bid is worse.
LAST_RESORT = -MAX_PERFORMANCE
_SHOWN = 3

Group: TypeAlias = tuple[Demand, ...]


@dataclass(frozen=True, slots=True)
class Bidding:
    """The bids for one local task of one request.

    `bids`: robot -> performance in micro-units, None where it has no bid, of all living robots
    that could be put on it and have spoken. `silent`: those that have not, while one more robot
    could be of use; they may still bid. `is_open`: the request waits for them, for `within_us`
    (None: `Timing.bid_us`).
    """

    activation: str
    global_task: str
    local_task: str
    bids: Mapping[str, int | None]
    silent: tuple[str, ...]
    is_open: bool
    within_us: int | None

    @property
    def closed_name(self) -> str:
        """The fact that nobody is waited for any more."""
        return f"{records.CLOSED}/{self.activation}/{self.local_task}"

    def to_json(self) -> dict[str, Any]:
        """Plain data; bids in units."""
        bids = {r: None if bid is None else bid / MICRO for r, bid in self.bids.items()}
        return {
            "activation": self.activation,
            "global_task": self.global_task,
            "local_task": self.local_task,
            "bids": bids,
            "silent": list(self.silent),
            "open": self.is_open,
        }


@dataclass(frozen=True, slots=True)
class _Known:
    """What the bids make of one request's demands, and from what that follows."""

    declared: Group
    state: tuple[int, bool]
    group: Group
    biddings: tuple[Bidding, ...]
    awaited: tuple[str, ...]


class Biddings:
    """The bids for the present requests. What nothing has changed for stays the same object."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}
        self._begun: frozenset[str] = frozenset()

    def follow(
        self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]
    ) -> tuple[Sequence[Group], tuple[Bidding, ...]]:
        """The demands with bids in the place of declared performances; and the biddings.

        Nobody is waited for once somebody runs the activation, is ready to, or has ended there:
        who comes later does not bring it to a halt.
        """
        if not facts.mission.has_bids:
            return groups, ()
        claims = [facts.valid_claim(robot) for robot in team]
        self._begun = frozenset(
            claim.activation
            for claim in claims
            if claim is not None and claim.phase > Phase.CLAIMED
        )
        before, self._known = self._known, {}
        result = []
        biddings: list[Bidding] = []
        for group in groups:
            request = group[0].request
            task, activation = facts.mission.global_tasks[request.subject], request.activation
            if any(need.by_bid for need in task.needs):
                is_begun = activation in self._begun or facts.is_begun(activation)
                state = facts.bid_state(activation), is_begun
                known = before.get(activation)
                if known is None or known.declared is not group or known.state != state:
                    known = _with_bids(facts, group, task.needs, state)
                self._known[activation] = known
                biddings += known.biddings
                group = known.group
            result.append(group)
        return result, tuple(biddings)

    def held_back(
        self, groups: Sequence[Group], kept: Sequence[int], lines: Mapping[str, Line]
    ) -> dict[int, tuple[str, ...]]:
        """The kept requests that get nobody yet -> the robots whose bids are waited for.

        Those are the ones that wait themselves, and further right those that would take a robot
        that one of them could have, unless somebody is at them already. So the bids decide
        for all of them together; and nothing waits for what stands further right.
        """
        held: dict[int, tuple[str, ...]] = {}
        if not any(known.awaited for known in self._known.values()):
            return held
        chosen: dict[str, list[str]] = {}
        for robot, line in lines.items():
            chosen.setdefault(line.activation, []).append(robot)
        sought, silent = set[str](), set[str]()
        for index in sorted(kept):
            activation = groups[index][0].request.activation
            known = self._known.get(activation)
            if known is not None and known.awaited:
                sought.update(*(demand.candidates for demand in groups[index]))
                silent.update(known.awaited)
                held[index] = known.awaited
            elif activation not in self._begun and not sought.isdisjoint(
                chosen.get(activation, ())
            ):
                held[index] = tuple(sorted(silent))
        return held


def _with_bids(
    facts: TeamFacts, group: Group, needs: Sequence[Need], state: tuple[int, bool]
) -> _Known:
    found = {
        need.local_task: _bidding(facts, demand, need, state[1])
        for demand, need in zip(group, needs, strict=True)
        if need.by_bid
    }
    silent = sorted({r for bidding in found.values() if bidding.is_open for r in bidding.silent})
    changed = []
    for demand in group:
        if silent:
            # It keeps free as many robots as it needs, and it is all the same to it which ones.
            candidates: Mapping[str, int] = dict.fromkeys(demand.candidates, 0)
            demand = replace(demand, upper=demand.lower, candidates=candidates)
        elif demand.local_task in found:
            bids = found[demand.local_task].bids
            candidates = {robot: _worth(bids.get(robot)) for robot in demand.candidates}
            demand = replace(demand, candidates=candidates)
        changed.append(demand)
    return _Known(group, state, tuple(changed), tuple(found.values()), tuple(silent))


def _worth(bid: int | None) -> int:
    return LAST_RESORT if bid is None else bid


def _bidding(facts: TeamFacts, demand: Demand, need: Need, is_begun: bool) -> Bidding:
    activation, local_task = demand.request.activation, demand.local_task
    known = facts.bids(activation, local_task)
    silent: tuple[str, ...] = ()
    if demand.upper > len(demand.pinned):
        silent = tuple(robot for robot in demand.candidates if robot not in known)
    return Bidding(
        activation,
        demand.request.subject,
        local_task,
        {robot: known[robot] for robot in demand.candidates if robot in known},
        silent,
        bool(silent) and not is_begun and not facts.is_closed(activation, local_task),
        need.bid_within_us,
    )


def shortened(robots: Sequence[str]) -> str:
    """For people: all of a few robots, else some of them and how many more."""
    if len(robots) <= _SHOWN + 1:
        return ", ".join(robots)
    return f"{', '.join(robots[:_SHOWN])} and {len(robots) - _SHOWN} more"
