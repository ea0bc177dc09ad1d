"""Proposals of schedules, which this robot searches for in its spare time.

Each robot begins its search elsewhere, so the team finds better schedules than one robot would. A
slow robot need not find any. Of the robots on one computer only the first one searches, as they
would otherwise keep each other from their work.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import SearchSchedule
from mrbt_mesh.core.agent.inputs import ScheduleFound, TravelTimesMade
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    MAX_OVERTAKEN,
    NO_TRAVEL_TIMES,
    Claim,
    Overtaken,
    Phase,
    Proposal,
    TeamTime,
    TravelTimes,
)
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.mission.travel import ways_between
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.problem import SchedulingProblem
from mrbt_mesh.core.scheduling.search import search, search_steps

# Evaluating an order takes time in proportion to tasks times robots. On a usual machine a third of
# a second is enough for the first of these numbers, some 8 ms for the second. Up to the third one,
# a problem is so small that a quick search is worthwhile. Where tasks have an order, schedules have
# to be mended, which takes so much longer per this many robots.
MOST_WORK, QUICK_WORK, LITTLE_WORK, ROBOTS_MENDED = 1_200_000, 30_000, 4_000, 3
# Few tasks have few orders: more evaluations than this per pair of tasks, or than the last of these
# numbers if that is more, find nothing new. Whether tasks have an order, so that few are allowed ->
# evaluations per pair.
MIN_EVALUATIONS, ENOUGH_EVALUATIONS, EVALUATIONS_PER_PAIR = 50, 400, {False: 25, True: 8}
# While there are deadlines ahead, the time is written again after this long.
TIME_US = 5_000_000
# After a robot has joined, nobody begins anything for this long: others may be joining, and the
# first robot makes a short search.
SETTLE_US = 50_000
# A robot on its way says what is left each time that it is half as much, but not below this.
LEAST_LEFT_US = 1_000_000


def evaluations_of(problem: SchedulingProblem) -> int:
    """The number of orders that a robot evaluates."""
    in_time = max(MOST_WORK // _work_of(problem), MIN_EVALUATIONS)
    pairs = len(problem.tasks) ** 2
    return min(in_time, max(ENOUGH_EVALUATIONS, EVALUATIONS_PER_PAIR[problem.has_order] * pairs))


def _tells_us(ends_us: int, now_us: int) -> int:
    """When half of what is left will be left, or never if that is too little."""
    half_us = (ends_us - now_us) // 2
    return now_us + half_us if half_us >= LEAST_LEFT_US else NEVER_US


def _work_of(problem: SchedulingProblem) -> int:
    robots = len(problem.free_ms)
    mending = -(-robots // ROBOTS_MENDED) if problem.has_order else 1
    return len(problem.tasks) * robots * mending


class _Way(NamedTuple):
    """A way of this robot: to what, between which places, when it should end, and when the robot
    says next how much is left.
    """

    activation: str
    ends: tuple[str, str]
    ends_us: int
    tells_us: int


class Scheduler:
    """Searches for schedules, and proposes what it has found.

    `settles_us`: until when the robot begins nothing, None if it never had to wait.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self.settles_us: int | None = None
        self._robots: frozenset[str] = frozenset()
        self._number = 0
        self._is_searching = False
        # What it last searched a schedule for, None if it never has.
        self._searched: Lookahead | None = None
        # Whether the result was hardly better than what rules alone achieve.
        self._are_rules_as_good = False
        # The activation it last set out for, or began without a way: it overtakes others only once.
        self._begun = ""
        # The way that it is on, or last was; whether it has turned round since it last worked.
        self._way: _Way | None = None
        self._has_turned = False
        self._wrote_time_us: int | None = None
        # The last proposal in force that was compared with the result of rules.
        self._compared: Proposal | None = None
        # The travel times of all robots in the last search; its own that are not published yet.
        self._times: Mapping[str, TravelTimes] = {}
        self._unpublished: TravelTimes | None = None
        if context.mission.travel is not None:
            # With many places this takes a while, so it is done in advance, while no deadline is
            # running.
            for kind in sorted({robot.type for robot in context.mission.robots.values()}):
                context.mission.travel.table(kind)

    def follow(self, plan: Plan, now_us: int) -> None:
        """Search a schedule for what lies ahead, once. Search again if there are new tasks, or at
        once if the robots changed, as what a search found without them is of little use.

        If there are few tasks, the first robot at once proposes the result of a short search.
        """
        self._publish_travel_times(now_us)
        ahead = plan.ahead
        if ahead is None:
            return
        self._settle(ahead, now_us)
        self._tell_time(ahead, now_us)
        self._tell_way(ahead, now_us)
        self._outdo(ahead, now_us)
        if self._is_searching and self._is_for(ahead):
            return
        # A single task needs no search, unless it waits for other robots than those that are idle.
        is_waiting = ahead.opens and ahead.author and ahead.idle and not ahead.problem.under_way
        if (
            (len(ahead.opens) < 2 and not is_waiting)
            or not self._is_due(ahead)
            or not self._is_first_here(ahead)
        ):
            self._withdraw(ahead, plan, now_us)
            return
        self._searched, self._is_searching = ahead, True
        self._times = dict(self._context.facts.travel_times)
        self._number += 1
        problem, me = ahead.problem, self._context.me
        seed = sorted({*self._context.mission.robots, me}).index(me)
        steps = search_steps(problem, evaluations_of(problem), seed)
        self._context.emit(SearchSchedule(self._number, steps))
        if me == min(ahead.robots) and _work_of(problem) <= LITTLE_WORK:
            count = min(evaluations_of(problem), QUICK_WORK // _work_of(problem))
            self._propose(ahead.proposal(search(problem, count, seed).schedule), ahead, now_us)

    def travel_times_made(self, event: TravelTimesMade, _: int) -> None:
        """Keep the travel times until the next plan, when the robot has joined."""
        self._unpublished = event.times

    def _publish_travel_times(self, now_us: int) -> None:
        times, self._unpublished = self._unpublished, None
        known = self._context.facts.travel_times.get(self._context.me, NO_TRAVEL_TIMES)
        if times is not None and times != known:
            self._context.write([(records.TRAVEL_TIMES, times)], now_us)

    def _settle(self, ahead: Lookahead, now_us: int) -> None:
        """Wait a little after robots have joined.

        Robots that start together join within milliseconds, and equal plans do not show that all
        know of the last one. A robot that is alone, and expects nobody, need not wait.
        """
        robots = frozenset(ahead.robots)
        others = (robots | self._context.config.expected) - {self._context.me}
        if others and len(ahead.opens) > 1 and robots - self._robots:
            self.settles_us = now_us + SETTLE_US
        self._robots = robots

    def _tell_time(self, ahead: Lookahead, now_us: int) -> None:
        """Write the time if there are deadlines ahead, since lateness is computed from it."""
        clock, written_us = self._context.wall_clock, self._wrote_time_us
        if clock is None or not clock.is_believed or not self._is_first_here(ahead):
            return
        if written_us is not None and now_us < written_us + TIME_US:
            return
        unix_us = clock.team_us(now_us)
        if unix_us and any(place.deadline_us for place in ahead.order.values()):
            self._wrote_time_us = now_us
            self._context.write([(records.TEAM_TIME, TeamTime(unix_us))], now_us)

    @property
    def deadlines_us(self) -> tuple[int | None, int | None]:
        """When `follow` is due at the latest, if nothing else happens."""
        return self.settles_us, self._way.tells_us if self._way is not None else None

    def _tell_way(self, ahead: Lookahead, now_us: int) -> None:
        """Write how much of the way is left, so that others neither wait for this robot nor replace
        it as if it had just set out.
        """
        way, claim = self._way, self._context.work.claim
        if way is None or now_us < way.tells_us or claim is None:
            return
        self._way = way._replace(tells_us=_tells_us(way.ends_us, now_us))
        if claim.activation == way.activation and claim.phase is Phase.TRAVELLING:
            counts = self._counts(ahead)
            self._context.write([(records.OVERTAKEN, self._noted(counts, now_us))], now_us)

    def _set_out(self, claim: Claim, goal: str, now_us: int) -> _Way | None:
        """The way for a claim: from a place, or from where the robot is on its way elsewhere. None
        if nobody knows where it begins, as at a place that a revision has removed.
        """
        facts, before, origin = self._context.facts, self._way, claim.place
        travel, table = facts.mission.travel, facts.travel_table(self._context.me)
        assert travel is not None
        numbers = {place: number for number, place in enumerate(travel.places)}
        if origin not in numbers:
            return None
        at, to = numbers[origin], numbers[goal]
        left_ms = table[at][to]
        if before is not None and before.ends[0] == origin and before.ends[1] in numbers:
            rest_ms = max(0, before.ends_us - now_us) // 1_000
            left_ms = ways_between(table, at, numbers[before.ends[1]], rest_ms)[to]
        ends_us = now_us + left_ms * 1_000
        return _Way(claim.activation, (origin, goal), ends_us, _tells_us(ends_us, now_us))

    def _counts(self, ahead: Lookahead) -> dict[str, int]:
        """How often this robot has overtaken what still lies ahead."""
        before = self._context.facts.overtakings.get(self._context.me)
        counts = before.counts if before is not None else {}
        return {name: count for name, count in counts.items() if name in ahead.order}

    def _noted(self, counts: Mapping[str, int], now_us: int) -> Overtaken:
        left_us = self._way.ends_us - now_us if self._way is not None else 0
        return Overtaken(self._begun, self._has_turned, max(0, left_us) // 1_000, counts)

    def begins(self, plan: Plan, claim: Claim, travel_to: str, now_us: int) -> list[Fact]:
        """The facts to write when the robot sets out for something, or begins to work on it: what
        it overtakes, and whether it has turned round for it.

        As all robots agree at this time, it also withdraws a proposal of its own that is not in
        force, since finished work and ways could make that seem better.
        """
        begun, self._begun = self._begun, claim.activation
        way, is_way = self._way, bool(travel_to)
        self._way = self._set_out(claim, travel_to, now_us) if is_way else None
        ahead, me, left = plan.ahead, self._context.me, way.activation if way is not None else ""
        turns = is_way and ahead is not None and ahead.turns_from(left, claim.activation)
        if ahead is None or (claim.activation == begun and (self._has_turned or not turns)):
            return []
        is_outdone = self._is_outdone(ahead) and not ahead.problem.has_order
        taken_back: list[Fact] = [(records.SCHEDULE, Proposal(()))] if is_outdone else []
        self._has_turned = is_way and (self._has_turned or turns)
        passed = [] if claim.activation == begun else ahead.overtaken_by(me, claim.activation)
        if not passed and not self._has_turned:
            return taken_back
        counts = self._counts(ahead)
        for name in passed:
            counts[name] = min(MAX_OVERTAKEN, counts.get(name, 0) + 1)
        return [*taken_back, (records.OVERTAKEN, self._noted(counts, now_us))]

    def _withdraw(self, ahead: Lookahead, plan: Plan, now_us: int) -> None:
        """Withdraw its proposal once all robots follow another one. Costs change a little with
        every event, and no robot should turn round for that.
        """
        context = self._context
        if self._is_outdone(ahead) and context.membership.all_report_plan(plan.digest):
            context.write([(records.SCHEDULE, Proposal(()))], now_us)

    def _is_outdone(self, ahead: Lookahead) -> bool:
        """True if it has a proposal, but another robot's is in force."""
        mine = self._context.facts.proposals.get(self._context.me)
        return mine is not None and bool(mine.steps) and ahead.author not in ("", self._context.me)

    def _outdo(self, ahead: Lookahead, now_us: int) -> None:
        """Propose the result of rules if the schedule in force is twice as long, as a lying robot's
        may be. A smaller difference may only be apparent, as works count as half done.
        """
        proposal = self._context.facts.proposals.get(ahead.author)
        if proposal is self._compared or ahead.course is None or not self._is_first_here(ahead):
            return
        self._compared = proposal
        ruled = ahead.by_rules()
        if ruled.rank.is_clearly_better(ahead.course.rank, margin=2):
            self._context.write([(records.SCHEDULE, ahead.proposal(ruled.schedule))], now_us)

    def _is_first_here(self, ahead: Lookahead) -> bool:
        """True if no robot with a lower id is known to be on the same computer."""
        me, members = self._context.me, self._context.facts.members
        host = members[me].member.host
        here = (robot for robot in ahead.robots if members[robot].member.host == host)
        return not host or me == min(here, default=me)

    def _is_for(self, ahead: Lookahead) -> bool:
        """True if the last search was for these robots."""
        before = self._searched
        return before is not None and set(ahead.robots) == set(before.robots)

    def _is_due(self, ahead: Lookahead) -> bool:
        before = self._searched
        if before is None or not self._is_for(ahead):
            return True
        if self._times != self._context.facts.travel_times:
            return True
        if not ahead.numbers.keys() <= before.numbers.keys() or ahead.idle - before.idle:
            return True
        if ahead.problem.has_order and ahead.idle and len(ahead.opens) < len(before.opens):
            return True  # once for each task that has begun, so this comes to an end
        if ahead.problem.has_deadlines and not before.problem.has_deadlines:
            return True  # the team now knows the time
        if self._are_rules_as_good or any(
            each.steps for each in self._context.facts.proposals.values()
        ):
            return False
        return ahead.problem != before.problem

    def found(self, event: ScheduleFound, plan: Plan | None, now_us: int) -> None:
        """Propose the schedule found, with its robots: how long those at work still need was known
        better before they began.
        """
        searched = self._searched
        if event.number != self._number or searched is None or not self._is_searching:
            return
        self._is_searching = False
        ahead = plan.ahead if plan is not None else None
        if plan is None or ahead is None or not ahead.opens or not self._context.has_place:
            return
        if ahead.numbers.keys() & searched.numbers.keys() and event.schedule:
            self._propose(searched.proposal(event.schedule), ahead, now_us)

    def _propose(self, proposal: Proposal, ahead: Lookahead, now_us: int) -> None:
        """Propose a schedule if it is clearly better than the one in force.

        Schedules by rules change with every event. If they are in force and nothing better was
        found, the first robot proposes the present one, which the team then carries out.
        """
        best = ahead.mended(proposal).rank
        if ahead.course is None or best.is_clearly_better(ahead.course.rank):
            self._are_rules_as_good = False
            self._context.write([(records.SCHEDULE, proposal)], now_us)
            return
        self._are_rules_as_good = not ahead.author
        is_first = self._context.me == min(ahead.robots)
        if is_first and not ahead.author and ahead.schedule and not ahead.problem.has_order:
            self._context.write([(records.SCHEDULE, ahead.proposal(ahead.schedule))], now_us)
