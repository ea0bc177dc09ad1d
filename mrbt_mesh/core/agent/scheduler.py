"""Proposals of schedules, which this robot searches for in its spare time.

Each robot begins its search elsewhere, so the team finds better ones than one robot would. A robot
that is slow need not find any. Of robots on one computer only the first one searches: together they
would keep each other from their work.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import SearchSchedule
from mrbt_mesh.core.agent.inputs import ScheduleFound, TravelTimesMade
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import NO_TRAVEL_TIMES, Proposal, TravelTimes
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.core.scheduling.problem import SchedulingProblem
from mrbt_mesh.core.scheduling.search import search, search_steps

# A proposal must cost less than the schedule in force by at least one part in this many.
MARGIN = 100
# To evaluate an order takes time in proportion to tasks times robots. On a usual machine a third of
# a second is enough for the first number of these, a few milliseconds for the second one.
MOST_WORK, LITTLE_WORK = 1_200_000, 4_000
# Few tasks have few orders: more evaluations per pair of tasks find nothing new.
MIN_EVALUATIONS, EVALUATIONS_PER_PAIR = 50, 25


def evaluations_of(problem: SchedulingProblem) -> int:
    """How many orders a robot tries."""
    in_time = max(MOST_WORK // _work_of(problem), MIN_EVALUATIONS)
    return min(in_time, EVALUATIONS_PER_PAIR * len(problem.tasks) ** 2)


def _work_of(problem: SchedulingProblem) -> int:
    return len(problem.tasks) * len(problem.free_ms)


class Scheduler:
    """Searches, and proposes what it has found."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._number = 0
        self._is_searching = False
        # What it has searched a schedule for last, None before.
        self._searched: Lookahead | None = None
        # The travel times of all robots in that search; its own that are not published yet.
        self._times: Mapping[str, TravelTimes] = {}
        self._unpublished: TravelTimes | None = None
        if context.mission.travel is not None:
            # With many places this takes a while, so it is done before there are deadlines.
            for kind in sorted({robot.type for robot in context.mission.robots.values()}):
                context.mission.travel.table(kind)

    def follow(self, plan: Plan, now_us: int) -> None:
        """Search a schedule for what lies ahead, once: again if there are new tasks or other
        robots, or what was proposed does not fit any more.

        Where none is in force the first robot at once proposes one by priority rules alone, if that
        takes little time.
        """
        self._publish_travel_times(now_us)
        ahead = plan.ahead
        if ahead is None or self._is_searching:
            return
        if len(ahead.opens) < 2 or not self._is_due(ahead) or not self._is_first_here(ahead):
            self._withdraw(ahead, plan, now_us)
            return
        self._searched, self._is_searching = ahead, True
        self._times = dict(self._context.facts.travel_times)
        self._number += 1
        problem, me = ahead.problem, self._context.me
        seed = sorted({*self._context.mission.robots, me}).index(me)
        steps = search_steps(problem, evaluations_of(problem), seed)
        self._context.emit(SearchSchedule(self._number, steps))
        is_first = ahead.schedule is None and me == min(ahead.robots)
        if is_first and _work_of(problem) <= LITTLE_WORK:
            proposal = ahead.proposal(search(problem, 0, seed).schedule)
            self._context.write([(records.SCHEDULE, proposal)], now_us)

    def travel_times_made(self, event: TravelTimesMade, _: int) -> None:
        """Keep them until the next plan: then the robot has joined."""
        self._unpublished = event.times

    def _publish_travel_times(self, now_us: int) -> None:
        times, self._unpublished = self._unpublished, None
        known = self._context.facts.travel_times.get(self._context.me, NO_TRAVEL_TIMES)
        if times is not None and times != known:
            self._context.write([(records.TRAVEL_TIMES, times)], now_us)

    def _withdraw(self, ahead: Lookahead, plan: Plan, now_us: int) -> None:
        """Take its proposal back once all robots follow another one. Costs change a little with
        every event, and no robot should turn round for that.
        """
        context = self._context
        mine = context.facts.proposals.get(context.me)
        if mine is None or not mine.steps or ahead.author in ("", context.me):
            return
        if context.membership.all_report_plan(plan.digest):
            context.write([(records.SCHEDULE, Proposal(()))], now_us)

    def _is_first_here(self, ahead: Lookahead) -> bool:
        """Whether no robot before it is on the same computer, as far as that is known."""
        me, members = self._context.me, self._context.facts.members
        host = members[me].member.host
        here = (robot for robot in ahead.robots if members[robot].member.host == host)
        return not host or me == min(here, default=me)

    def _is_due(self, ahead: Lookahead) -> bool:
        before = self._searched
        if before is None or ahead.robots != before.robots:
            return True
        if self._times != self._context.facts.travel_times:
            return True
        if not ahead.numbers.keys() <= before.numbers.keys():
            return True
        return ahead.schedule is None and ahead.problem != before.problem

    def found(self, event: ScheduleFound, plan: Plan | None, now_us: int) -> None:
        """Propose the order that was found, with the robots that suit it best now."""
        searched, ahead = self._searched, plan.ahead if plan is not None else None
        if event.number != self._number or searched is None or not self._is_searching:
            return
        self._is_searching = False
        if ahead is None or not ahead.opens or not self._context.has_place:
            return
        names = [searched.opens[step.task].request.activation for step in event.schedule]
        order = [ahead.numbers[name] for name in names if name in ahead.numbers]
        order += sorted(set(range(len(ahead.opens))) - set(order))
        best = Dispatcher(ahead.problem).dispatch(order)
        if ahead.course is None or best.cost * MARGIN < ahead.course.cost * (MARGIN - 1):
            proposal = ahead.proposal(best.schedule)
            self._context.write([(records.SCHEDULE, proposal)], now_us)
