"""Schedules: of those that robots propose, the best that fits the facts is in force.

A proposal is a fact, an order of the tasks that lie ahead with robots for each of them. Nothing of
it is taken on its author's word: it fits while what is left of it is a schedule of what is still
open, for the robots that are there; what it costs is computed from the facts. What has begun goes
on, whatever is proposed. So all robots with the same facts have the same schedule in force, or
none.

While one is in force each robot has the first of its tasks that is still open, once T_G asks for
it. Requests that schedules leave out, and all of them where none is in force, go to the robots that
*Check Consistency* and *Assign Agents* give them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from mrbt_mesh.core.bt.evaluation import Evaluation, Request
from mrbt_mesh.core.facts.records import Proposal, ProposedStep
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import Travel
from mrbt_mesh.core.planning.ahead import precedence, tasks_ahead
from mrbt_mesh.core.planning.capabilities import Capabilities
from mrbt_mesh.core.planning.demands import Demand, Group, request_demands
from mrbt_mesh.core.scheduling.dispatch import can_be_served
from mrbt_mesh.core.scheduling.problem import (
    Course,
    Schedule,
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    Step,
    course_of,
)


@dataclass(frozen=True, slots=True)
class Open:
    """One task of the problem with its demands. `needs`: what it still lacks."""

    request: Request
    group: Group
    needs: tuple[SchedulingNeed, ...]


@dataclass(frozen=True)
class Lookahead:
    """What schedules are made for: the tasks ahead that lack robots, and the robots there are.

    `opens` and `robots` are numbered as in `problem`. `left_out`: activation -> why it is none for
    a schedule. `schedule` is the one in force with its course, None without one, and `author` the
    robot that has proposed it.
    """

    opens: tuple[Open, ...]
    robots: tuple[str, ...]
    problem: SchedulingProblem
    left_out: Mapping[str, str]
    schedule: Schedule | None = None
    course: Course | None = None
    author: str = ""

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        """Activation -> the number of its task."""
        return {each.request.activation: number for number, each in enumerate(self.opens)}

    @cached_property
    def _steps(self) -> Mapping[str, Step]:
        opens = self.opens
        return {opens[step.task].request.activation: step for step in self.schedule or ()}

    @cached_property
    def next_steps(self) -> Mapping[str, Step]:
        """Robot -> the first step of the schedule in force that it has a part in."""
        found: dict[str, Step] = {}
        for step in self.schedule or ():
            for robots in step.coalition:
                for robot in robots:
                    found.setdefault(self.robots[robot], step)
        return found

    def is_next(self, robot: str, activation: str) -> bool:
        """Whether the schedule in force has this as the robot's next."""
        step = self.next_steps.get(robot)
        return step is not None and self.opens[step.task].request.activation == activation

    def step_of(self, activation: str) -> Step | None:
        """The step for this activation of the schedule in force, if there is one."""
        return self._steps.get(activation)

    def members(self, step: Step) -> list[str]:
        """The robots of a step, sorted by id."""
        return sorted(self.robots[robot] for robots in step.coalition for robot in robots)

    def proposal(self, schedule: Schedule) -> Proposal:
        """A schedule of this problem as a fact."""
        names = self.robots
        return Proposal(
            tuple(
                ProposedStep(
                    self.opens[step.task].request.activation,
                    tuple(tuple(names[robot] for robot in robots) for robots in step.coalition),
                )
                for step in schedule
            )
        )

    def fitting(self, proposal: Proposal) -> tuple[Schedule, Course] | None:
        """What is left of a proposal, if that is a schedule of this problem."""
        numbers = {robot: number for number, robot in enumerate(self.robots)}
        steps: list[Step] = []
        for activation, robots in ((each.activation, each.robots) for each in proposal.steps):
            task = self.numbers.get(activation)
            if task is None:
                continue
            group = self.opens[task].group
            if len(robots) != len(group) or any(name not in numbers for r in robots for name in r):
                return None
            # Without those at work there, and those that have ended there.
            coalition = tuple(
                tuple(
                    numbers[robot]
                    for robot in those
                    if robot in demand.candidates and robot not in demand.pinned
                )
                for those, demand in zip(robots, group, strict=True)
            )
            steps.append(Step(task, coalition))
        schedule = tuple(steps)
        try:
            return schedule, course_of(self.problem, schedule)
        except ValueError:
            return None


def look_ahead(
    facts: TeamFacts, evaluation: Evaluation, demands: Sequence[Group], capabilities: Capabilities
) -> Lookahead:
    """The problem of this moment, and the schedule in force; `demands`: of the present requests."""
    found = _lookahead(facts, evaluation, demands, capabilities)
    those = []
    for author in sorted(facts.proposals):
        fitting = found.fitting(facts.proposals[author])
        if fitting is not None and fitting[0]:
            those.append((*fitting, author))
    if not those:
        return found
    schedule, course, author = min(those, key=lambda each: (each[1].cost, each[0]))
    return replace(found, schedule=schedule, course=course, author=author)


def by_schedule(mission: Mission, ahead: Lookahead, demands: Sequence[Group]) -> Sequence[Group]:
    """The demands of the requests, for the robots whose next step each of them is.

    Those robots are no candidates for requests that are left out, but for a preemptive one, which
    takes them from tasks further right also before they have begun.
    """
    if ahead.schedule is None:
        return demands
    present = {group[0].request.activation: index for index, group in enumerate(demands)}
    at_work = {robot for group in demands for demand in group for robot in demand.pinned}
    due = {
        robot: present[activation]
        for robot, step in ahead.next_steps.items()
        if robot not in at_work
        and (activation := ahead.opens[step.task].request.activation) in present
    }
    result = []
    for index, group in enumerate(demands):
        step = ahead.step_of(group[0].request.activation)
        if step is None:
            is_preemptive = mission.global_tasks[group[0].request.subject].preemptive
            taken = {r for r, at in due.items() if at < index or not is_preemptive}
            result.append(tuple(_only(each, each.candidates.keys() - taken) for each in group))
            continue
        narrowed = []
        for demand, members in zip(group, step.coalition, strict=True):
            robots = {name for r in members if due.get(name := ahead.robots[r]) == index}
            count = len(robots) + len(demand.pinned)
            narrowed.append(replace(_only(demand, robots), lower=count, upper=count))
        result.append(tuple(narrowed))
    return result


def _only(demand: Demand, robots: Collection[str]) -> Demand:
    """A demand whose candidates are these robots, and those at work on it."""
    candidates = {
        robot: value
        for robot, value in demand.candidates.items()
        if robot in robots or robot in demand.pinned
    }
    return replace(demand, candidates=candidates)


# -- the problem ----------------------------------------------------------------------------------


def _lookahead(
    facts: TeamFacts, evaluation: Evaluation, demands: Sequence[Group], capabilities: Capabilities
) -> Lookahead:
    mission, evaluator = facts.mission, facts.mission.evaluator
    travel = mission.travel
    assert travel is not None
    rounds = tasks_ahead(evaluator, facts, evaluation, travel.horizon)
    after = precedence(evaluator, rounds)
    known = {group[0].request.activation: group for group in demands}
    places = {r: facts.place_of(r) for r in capabilities.team}
    numbers = {r: number for number, r in enumerate(r for r in places if places[r])}
    free_ms = dict.fromkeys(numbers, 0)
    ends_ms: dict[str, int] = {}
    opens: list[Open] = []
    left_out: dict[str, str] = {}
    for request in (each for found in rounds for each in found):
        activation = request.activation
        group = known.get(activation) or request_demands(facts, request, capabilities, {})
        for demand in group:
            for robot in demand.pinned:
                # How far it has got is not among the facts: on average half is left.
                work_ms = _work_ms(mission, demand, robot) // 2
                ends_ms[activation] = max(ends_ms.get(activation, 0), work_ms)
                if robot in numbers:
                    free_ms[robot] = work_ms
        needs = tuple(_need(mission, demand, numbers) for demand in group)
        reason = _why_left_out(mission, request, needs)
        if not reason and any(name in left_out for name in after.get(activation, ())):
            reason = "it comes after something that schedules leave out"
        if reason:
            left_out[activation] = reason
        elif any(need.robots for need in needs):
            opens.append(Open(request, group, needs))
    tasks = _tasks(mission, opens, list(travel.places), after, ends_ms)
    ways = [_way(facts, travel, robot) for robot in numbers]
    indices = {name: number for number, name in enumerate(travel.places)}
    home = travel.start if travel.has_way_back else {}
    problem = SchedulingProblem(
        tasks,
        tuple(free_ms.values()),
        tuple(at for at, _ in ways),
        tuple(table for _, table in ways),
        tuple(indices[home[robot]] if robot in home else None for robot in numbers),
        travel.objective,
    )
    return Lookahead(tuple(opens), tuple(numbers), problem, left_out)


def _need(mission: Mission, demand: Demand, numbers: Mapping[str, int]) -> SchedulingNeed:
    """What a demand still lacks."""
    able = demand.candidates.keys() - set(demand.pinned)
    work_ms = {numbers[r]: _work_ms(mission, demand, r) for r in sorted(able) if r in numbers}
    return SchedulingNeed(max(0, demand.lower - len(demand.pinned)), work_ms)


def _work_ms(mission: Mission, demand: Demand, robot: str) -> int:
    """How long a robot works on a local task, by its performance."""
    return -(-mission.nominal_work(demand.local_task) * 1_000 // demand.candidates[robot])


def _tasks(
    mission: Mission,
    opens: Sequence[Open],
    places: Sequence[str],
    after: Mapping[str, tuple[str, ...]],
    ends_ms: Mapping[str, int],
) -> tuple[SchedulingTask, ...]:
    assert mission.travel is not None
    numbers = {each.request.activation: number for number, each in enumerate(opens)}
    tasks = []
    for each in opens:
        before = after.get(each.request.activation, ())
        goal = mission.travel.at.get(each.group[0].local_task)
        tasks.append(
            SchedulingTask(
                None if goal is None else places.index(goal),
                each.needs,
                tuple(numbers[name] for name in before if name in numbers),
                mission.global_tasks[each.request.subject].by_coalition,
                max((ends_ms.get(name, 0) for name in before), default=0),
            )
        )
    return tuple(tasks)


def _way(facts: TeamFacts, travel: Travel, robot: str) -> tuple[int, Sequence[Sequence[int]]]:
    """Where a robot is, and its ways from there and between places."""
    places = list(travel.places)
    at, goal = places.index(facts.place_of(robot)), facts.under_way(robot)
    table = facts.travel_table(robot)
    if not goal:
        return at, table
    # How far it has come is not among the facts: on average half of the way is left.
    row = list(table[at])
    row[places.index(goal)] //= 2
    return len(places), [*table, row]


def _why_left_out(mission: Mission, request: Request, needs: Sequence[SchedulingNeed]) -> str:
    """Why a task is none for a schedule; empty if it is."""
    task, travel = mission.global_tasks[request.subject], mission.travel
    assert travel is not None
    if mission.constraints:
        return "the mission has side constraints"
    if request.node in mission.per_robot.guards:
        return "it depends on conditions that every robot has for itself"
    if task.exclusive:
        return "it is exclusive"
    if any(need.by_bid for need in task.needs):
        return "robots bid for it"
    if any(need.same_robot_as is not None for need in task.needs):
        return "it asks for a robot that did something before"
    if any(need.min_robots == 0 for need in task.needs):
        return "it has helpers that nobody waits for"
    if len({travel.at.get(need.local_task) for need in task.needs}) > 1:
        return "its local tasks are at several places"
    return "" if can_be_served(needs) else "it lacks robots"
