"""Proposals of schedules: this robot looks for one where none is in force, in its spare time.

Each robot begins elsewhere in its search, so that what the team finds is better than what one robot
would. One that is slow need not find any.
"""

from __future__ import annotations

from functools import partial

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.effects import SearchSchedule
from mrbt_mesh.core.agent.inputs import ScheduleFound
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.dispatch import Dispatcher
from mrbt_mesh.core.scheduling.problem import SchedulingProblem
from mrbt_mesh.core.scheduling.search import search

# By which part of the cost a proposal must be better than the schedule in force.
MARGIN = 100
# An evaluation takes about as long as there are tasks times robots. So many of these make a third
# of a second on a usual machine.
MOST_WORK = 600_000
MIN_EVALUATIONS, MAX_EVALUATIONS = 50, 10_000


class Scheduler:
    """Searches, and proposes what it has found."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._number = 0
        # What it searches a schedule for, None if it does not search; and did so last.
        self._searching: Lookahead | None = None
        self._searched: SchedulingProblem | None = None

    def follow(self, plan: Plan) -> None:
        """Search a schedule if the plan lacks one, and has not been searched for the same."""
        ahead = plan.ahead
        if ahead is None or ahead.schedule is not None or self._searching is not None:
            return
        problem = ahead.problem
        if len(problem.tasks) < 2 or problem == self._searched:
            return
        self._searching, self._searched = ahead, problem
        self._number += 1
        budget = MOST_WORK // (len(problem.tasks) * len(problem.free_ms))
        evaluations = min(max(budget, MIN_EVALUATIONS), MAX_EVALUATIONS)
        seed = sorted({*self._context.mission.robots, self._context.me}).index(self._context.me)
        find = partial(search, problem, evaluations, seed)
        self._context.emit(SearchSchedule(self._number, find))

    def found(self, event: ScheduleFound, plan: Plan | None, now_us: int) -> None:
        """Propose the order that was found, with the robots that suit it best now."""
        searched, ahead = self._searching, plan.ahead if plan is not None else None
        if event.number != self._number or searched is None:
            return
        self._searching = None
        if ahead is None or not ahead.opens or not self._context.has_place:
            return
        names = [searched.opens[step.task].request.activation for step in event.schedule]
        order = [ahead.numbers[name] for name in names if name in ahead.numbers]
        order += sorted(set(range(len(ahead.opens))) - set(order))
        best = Dispatcher(ahead.problem).dispatch(order)
        if ahead.course is None or best.cost * MARGIN < ahead.course.cost * (MARGIN - 1):
            proposal = ahead.proposal(best.schedule)
            self._context.write([(records.SCHEDULE, proposal)], now_us)
