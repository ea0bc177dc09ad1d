"""Bids in plans: performances that only the robots know, written once per activation.

Where a need has `performance: bid`, each robot that could be put on it writes one number as a fact.
The plan waits for the bids of living robots, for a short while, and then assigns exactly. One
broadcast per robot takes the place of an auction's rounds.

A robot without a bid when the wait is over counts with the worst performance: it serves where no
other robot can. So bids never keep a team from what it can do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.feature import Offer, PlanPart, PlanStep
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE, MICRO, GlobalTask, Need
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.demands import Demand, Group
from mrbt_mesh.core.planning.plan import Plan, RobotAssignment
from mrbt_mesh.features.bids.facts import bids_of
from mrbt_mesh.features.bids.needs import CLOSED, IN_PLAN, bid_within_us, by_bid

# What a robot without a bid counts with: no bid is worse.
LAST_RESORT = -MAX_PERFORMANCE


@dataclass(frozen=True, slots=True)
class Bidding:
    """The bids for one local task of one request.

    `bids`: robot -> performance in micro-units, None where it has no bid, of all living robots
    that could be put on it and have spoken. `silent`: those that have not, while one more robot
    could be of use; they may still bid. `is_open`: the request waits for them, for `within_us`
    (None: three tenths of the detection time).
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
        return f"{CLOSED}/{self.activation}/{self.local_task}"

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
class Biddings(PlanPart):
    """The bids for all local tasks that a plan's requests have by bid, in the order of these."""

    rows: tuple[Bidding, ...]

    name = IN_PLAN

    def to_json(self) -> list[Any]:
        """See `PlanPart`."""
        return [bidding.to_json() for bidding in self.rows]

    def deadlines(self, detection_us: int) -> Mapping[str, int]:
        """See `PlanPart`: no more bids are awaited."""
        usual_us = detection_us * 3 // 10
        return {
            bidding.closed_name: usual_us if bidding.within_us is None else bidding.within_us
            for bidding in self.rows
            if bidding.is_open
        }

    def performance_text(self, assignment: RobotAssignment) -> str:
        """See `PlanPart`."""
        for bidding in self.rows:
            if (bidding.activation, bidding.local_task) == (
                assignment.activation,
                assignment.local_task,
            ):
                is_bid = bidding.bids.get(assignment.robot) is not None
                return f"bid {assignment.performance / MICRO:g}" if is_bid else "no bid"
        return ""


def biddings(plan: Plan) -> tuple[Bidding, ...]:
    """The bids for all local tasks that the plan's requests have by bid."""
    part = plan.parts.get(IN_PLAN)
    return part.rows if isinstance(part, Biddings) else ()


def plan_bids(plan: Plan) -> dict[tuple[str, str], Mapping[str, int | None]]:
    """(activation, local task) -> robot -> its bid, or None."""
    return {(b.activation, b.local_task): b.bids for b in biddings(plan)}


@dataclass(frozen=True, slots=True)
class GroupBids:
    """What the bids make of one request's demands.

    `group` has bids in the place of declared performances; `awaited` are the robots whose bids the
    request waits for.
    """

    group: Group
    biddings: tuple[Bidding, ...]
    awaited: tuple[str, ...]


class BidStep(PlanStep):
    """Has plans wait for bids, and puts them in the place of performances."""

    def offer(
        self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]
    ) -> BidOffer:
        """See `PlanStep`.

        Nobody is waited for once somebody runs the activation, is ready to, or has ended there: who
        comes later does not bring it to a halt.
        """
        begun = begun_activations(facts, team)
        found = [with_bids(facts, group, is_begun(facts, group, begun)) for group in groups]
        return BidOffer(found, begun)

    def why_unscheduled(self, task: GlobalTask) -> str:
        """See `PlanStep`."""
        return "robots bid for it" if any(map(by_bid, task.needs)) else ""


class BidOffer(Offer):
    """What the bids make of the requests' demands.

    `begun`: the activations with a robot on them.
    """

    awaited_things = "bids"

    def __init__(self, found: Sequence[GroupBids], begun: frozenset[str]) -> None:
        rows = tuple(bidding for each in found for bidding in each.biddings)
        super().__init__([each.group for each in found], Biddings(rows))
        # The requests, by index, that wait for bids of robots.
        self._awaited = {index: each.awaited for index, each in enumerate(found) if each.awaited}
        self._begun = begun

    def postponed(
        self, kept: Sequence[int], assignments: Mapping[str, RobotAssignment]
    ) -> Mapping[int, tuple[str, ...]]:
        """See `Offer`.

        Those are the requests that wait for bids themselves, and further right those that would
        take a robot that one of them could have, unless somebody is at them already. So the bids
        decide for all of them together; and nothing waits for requests further right.
        """
        held: dict[int, tuple[str, ...]] = {}
        if not self._awaited:
            return held
        chosen: dict[str, list[str]] = {}
        for robot, assignment in assignments.items():
            chosen.setdefault(assignment.activation, []).append(robot)
        sought, silent = set[str](), set[str]()
        for index in sorted(kept):
            group, awaited = self.groups[index], self._awaited.get(index)
            activation = group[0].request.activation
            if awaited:
                sought.update(*(demand.candidates for demand in group))
                silent.update(awaited)
                held[index] = awaited
            elif activation not in self._begun and not sought.isdisjoint(
                chosen.get(activation, ())
            ):
                held[index] = tuple(sorted(silent))
        return held


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
        if by_bid(need)
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
    said = bids_of(facts, activation)
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
        bid_within_us(need),
    )
