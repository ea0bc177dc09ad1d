"""Bids: performances that only the robots know, written once per activation.

Where a need has `performance: bid`, each robot that could be put on it writes one number as a fact.
The plan waits for the bids of living robots, for a short while, and then assigns exactly. One
broadcast per robot takes the place of an auction's rounds.

A robot without a bid when the wait is over counts with the worst performance: it serves where no
other robot can. So bids never keep a team from what it can do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, Need
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.demands import Demand, Group
from mrbt_mesh.core.planning.plan import Bidding, RobotAssignment

# What a robot without a bid counts with: no bid is worse.
LAST_RESORT = -MAX_PERFORMANCE


@dataclass(frozen=True, slots=True)
class GroupBids:
    """What the bids make of one request's demands.

    `group` has bids in the place of declared performances; `awaited` are the robots whose bids the
    request waits for.
    """

    group: Group
    biddings: tuple[Bidding, ...]
    awaited: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Bids:
    """What the bids make of the requests' demands.

    `groups` are the demands of each request; `awaited`: the requests, by index, that wait for bids
    of robots; `begun`: the activations with a robot on them.
    """

    groups: Sequence[Group]
    biddings: tuple[Bidding, ...] = ()
    awaited: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    begun: frozenset[str] = frozenset()

    @classmethod
    def of(cls, groups: Sequence[GroupBids], begun: frozenset[str]) -> Bids:
        """Of all requests together, in their order."""
        return cls(
            [bids.group for bids in groups],
            tuple(bidding for bids in groups for bidding in bids.biddings),
            {index: bids.awaited for index, bids in enumerate(groups) if bids.awaited},
            begun,
        )

    def held_back(
        self, kept: Sequence[int], assignments: Mapping[str, RobotAssignment]
    ) -> dict[int, tuple[str, ...]]:
        """The kept requests that get nobody yet -> the robots whose bids are waited for.

        Those are the ones that wait themselves, and further right those that would take a robot
        that one of them could have, unless somebody is at them already. So the bids decide
        for all of them together; and nothing waits for requests further right.
        """
        held: dict[int, tuple[str, ...]] = {}
        if not self.awaited:
            return held
        chosen: dict[str, list[str]] = {}
        for robot, assignment in assignments.items():
            chosen.setdefault(assignment.activation, []).append(robot)
        sought, silent = set[str](), set[str]()
        for index in sorted(kept):
            group, awaited = self.groups[index], self.awaited.get(index)
            activation = group[0].request.activation
            if awaited:
                sought.update(*(demand.candidates for demand in group))
                silent.update(awaited)
                held[index] = awaited
            elif activation not in self.begun and not sought.isdisjoint(chosen.get(activation, ())):
                held[index] = tuple(sorted(silent))
        return held


def bids_for(facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]) -> Bids:
    """What the bids make of the demands.

    Nobody is waited for once somebody runs the activation, is ready to, or has ended there: who
    comes later does not bring it to a halt.
    """
    begun = begun_activations(facts, team)
    return Bids.of(
        [with_bids(facts, group, is_begun(facts, group, begun)) for group in groups], begun
    )


def is_begun(facts: TeamFacts, group: Group, begun: frozenset[str]) -> bool:
    """Whether somebody is at the group's request, or has ended there."""
    activation = group[0].request.activation
    return activation in begun or facts.has_outcome(activation)


def begun_activations(facts: TeamFacts, team: Mapping[str, Worker]) -> frozenset[str]:
    """The activations that somebody of the team runs, or is ready to."""
    claims = (facts.valid_claim(robot) for robot in team)
    return frozenset(c.activation for c in claims if c is not None and c.phase > Phase.CLAIMED)


def with_bids(facts: TeamFacts, group: Group, has_begun: bool) -> GroupBids:
    """What the bids make of the demands of one request."""
    needs = facts.mission.global_tasks[group[0].request.subject].needs
    found = {
        need.local_task: _bidding(facts, demand, need, has_begun)
        for demand, need in zip(group, needs, strict=True)
        if need.by_bid
    }
    if not found:
        return GroupBids(group, (), ())
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
    return GroupBids(tuple(changed), tuple(found.values()), tuple(silent))


def _worth(bid: int | None) -> int:
    return LAST_RESORT if bid is None else bid


def _bidding(facts: TeamFacts, demand: Demand, need: Need, has_begun: bool) -> Bidding:
    activation, local_task = demand.request.activation, demand.local_task
    said = facts.bids(activation)
    known = said.of(local_task)
    silent: tuple[str, ...] = ()
    if demand.upper > len(demand.pinned):
        silent = tuple(robot for robot in demand.candidates if robot not in known)
    return Bidding(
        activation,
        demand.request.subject,
        local_task,
        {robot: known[robot] for robot in demand.candidates if robot in known},
        silent,
        bool(silent) and not has_begun and local_task not in said.closed,
        need.bid_within_us,
    )
