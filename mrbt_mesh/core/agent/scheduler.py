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
from mrbt_mesh.core.facts.records import NO_TRAVEL_TIMES, Proposal, ProposedStep, TravelTimes
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.dispatch import Dispatched, Dispatcher
from mrbt_mesh.core.scheduling.problem import Course, SchedulingProblem
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


def course_of_assignment(ahead: Lookahead, plan: Plan) -> Course | None:
    """What comes of the plan's assignment, if that has the robots for all tasks ahead at once."""
    given: dict[tuple[str, str], list[str]] = {}
    for each in plan.assignments.values():
        given.setdefault((each.activation, each.local_task), []).append(each.robot)
    steps = []
    for activation, group in ((each.request.activation, each.group) for each in ahead.opens):
        robots = (given.get((activation, demand.local_task), ()) for demand in group)
        steps.append(ProposedStep(activation, tuple(map(tuple, robots))))
    fitting = ahead.fitting(Proposal(tuple(steps)))
    return None if fitting is None else fitting[1]


class Scheduler:
    """Searches, and proposes what it has found."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._number = 0
        self._is_searching = False
        # What it has searched a schedule for last, None before.
        self._searched: Lookahead | None = None
        # Whether the exact assignment was foretold to be as good as what was found.
        self._is_assignment_as_good = False
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

        The first robot at once proposes one by priority rules alone, if that takes little time.
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
        if me == min(ahead.robots) and _work_of(problem) <= LITTLE_WORK:
            self._propose(search(problem, 0, seed), plan, ahead, now_us)

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
        if ahead.schedule is not None or self._is_assignment_as_good:
            return False
        return ahead.problem != before.problem

    def found(self, event: ScheduleFound, plan: Plan | None, now_us: int) -> None:
        """Propose the order that was found, with the robots that suit it best now."""
        searched = self._searched
        if event.number != self._number or searched is None or not self._is_searching:
            return
        self._is_searching = False
        ahead = plan.ahead if plan is not None else None
        if plan is None or ahead is None or not ahead.opens or not self._context.has_place:
            return
        names = [searched.opens[step.task].request.activation for step in event.schedule]
        order = [ahead.numbers[name] for name in names if name in ahead.numbers]
        order += sorted(set(range(len(ahead.opens))) - set(order))
        self._propose(Dispatcher(ahead.problem).dispatch(order), plan, ahead, now_us)

    def _propose(self, found: Dispatched, plan: Plan, ahead: Lookahead, now_us: int) -> None:
        """Propose what is better than the schedule in force or, without one, than the exact
        assignment, if that has robots for all tasks at once.
        """
        known = ahead.course or course_of_assignment(ahead, plan)
        self._is_assignment_as_good = False
        if known is None or found.cost * MARGIN < known.cost * (MARGIN - 1):
            self._context.write([(records.SCHEDULE, ahead.proposal(found.schedule))], now_us)
        else:
            self._is_assignment_as_good = ahead.course is None
