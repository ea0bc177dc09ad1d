"""Schedules: of those that robots propose, the best that fits the facts is in force.

A proposal is a fact, an order of the tasks that lie ahead with robots for each of them. Nothing of
it is taken on its author's word: steps that are over are left out, tasks that it lacks come last,
robots that are not there are replaced, and where it breaks the order of tasks (`task_order`) it is
mended (`scheduling.order`). What that comes to is computed from the facts. Schedules by rules alone
need no proposal. So all robots with the same facts have the same schedule in force.

Each robot has the first of its tasks that is still open, once T_G asks for it. Requests that
schedules leave out go to the robots that *Check Consistency* and *Assign Agents* give them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from mrbt_mesh.core.bt.evaluation import Evaluation, Request
from mrbt_mesh.core.facts.records import Phase, Proposal, ProposedStep
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.travel import MAX_MS, Travel, ways_between
from mrbt_mesh.core.planning.ahead import precedence, tasks_ahead
from mrbt_mesh.core.planning.capabilities import Capabilities
from mrbt_mesh.core.planning.demands import Demand, Group, request_demands
from mrbt_mesh.core.planning.task_order import OrderKey, task_order
from mrbt_mesh.core.scheduling.dispatch import Dispatched, Dispatcher, can_be_served
from mrbt_mesh.core.scheduling.order import (
    by_rules,
    could_begin,
    first_tasks,
    mended,
    overtaken,
)
from mrbt_mesh.core.scheduling.problem import (
    Course,
    Crew,
    Schedule,
    SchedulingNeed,
    SchedulingProblem,
    SchedulingTask,
    Step,
    course_of,
    turning,
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
    a schedule. `order`: activation -> its place among the tasks ahead. `schedule` is the one in
    force with its course, None where nothing is open, and `author` the robot that has proposed it;
    empty if it is one by rules.
    """

    opens: tuple[Open, ...]
    robots: tuple[str, ...]
    problem: SchedulingProblem
    left_out: Mapping[str, str]
    order: Mapping[str, OrderKey] = field(default_factory=dict)
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
            for robots in step.crew:
                for robot in robots:
                    found.setdefault(self.robots[robot], step)
        return found

    @cached_property
    def idle(self) -> frozenset[str]:
        """The robots for which the schedule in force has nothing, and that could do something."""
        tasks, at_work = self.problem.tasks, self.problem.at_work
        able = {r for task in tasks for need in task.needs if need.robots for r in need.work_ms}
        return frozenset(self.robots[r] for r in able - at_work) - self.next_steps.keys()

    def is_next(self, robot: str, activation: str) -> bool:
        """Whether the schedule in force has this as the robot's next."""
        step = self.next_steps.get(robot)
        return step is not None and self.opens[step.task].request.activation == activation

    def step_of(self, activation: str) -> Step | None:
        """The step for this activation of the schedule in force, if there is one."""
        return self._steps.get(activation)

    def members(self, step: Step) -> list[str]:
        """The robots of a step, sorted by id."""
        return sorted(self.robots[robot] for robots in step.crew for robot in robots)

    def proposal(self, schedule: Schedule) -> Proposal:
        """A schedule of this problem as a fact."""
        names = self.robots
        return Proposal(
            tuple(
                ProposedStep(
                    self.opens[step.task].request.activation,
                    tuple(tuple(names[robot] for robot in robots) for robots in step.crew),
                )
                for step in schedule
            )
        )

    @cached_property
    def dispatcher(self) -> Dispatcher:
        """Of the problem."""
        return Dispatcher(self.problem)

    def by_rules(self) -> Dispatched:
        """The best schedule that needs no search. It turns nobody round: other rules may hold for a
        robot that has turned, and lead it back.
        """
        problem = self.problem
        found = by_rules(problem, self.dispatcher)
        if problem.under_way:
            found = [each for each in found if not turning(problem, each.schedule)] or found
        return min(found, key=lambda each: (each.rank, each.schedule))

    def mended(self, proposal: Proposal) -> Dispatched:
        """What a proposal comes to now: a schedule of all that is open."""
        hints: dict[int, Crew] = {}
        numbers = {robot: number for number, robot in enumerate(self.robots)}
        for step in proposal.steps:
            task = self.numbers.get(step.activation)
            if task is not None and task not in hints:
                hints[task] = self._crew(task, step.robots, numbers)
        return mended(self.problem, self.dispatcher, list(hints), hints)

    def _crew(
        self, task: int, proposed: Sequence[Sequence[str]], numbers: Mapping[str, int]
    ) -> Crew:
        """The robots that are there, of those proposed, as many as each need still lacks."""
        crew, taken = [], set[int]()
        for index, need in enumerate(self.problem.tasks[task].needs):
            own: list[int] = []
            for name in proposed[index] if index < len(proposed) else ():
                robot = numbers.get(name)
                if robot is None or robot in taken or len(own) == need.robots:
                    continue
                if robot in need.work_ms:
                    own.append(robot)
                    taken.add(robot)
            crew.append(tuple(own))
        return tuple(crew)

    def turns_from(self, way: str, begun: str) -> bool:
        """True if a robot that was on its way to one task turns round by beginning the other one,
        which has no priority; or has turned round, and sets out for the same one again.
        """
        left, own = self.numbers.get(way), self.order.get(begun)
        if left is None or own is None or not self.problem.has_order:
            return False
        return own.level >= self.problem.tasks[left].level

    def overtaken_by(self, robot: str, activation: str) -> list[str]:
        """The tasks that a robot overtakes when it begins this now, by the schedule in force; or as
        the last one of a crew, after which the task is not open any more.
        """
        own, number = self.order.get(activation), self.numbers.get(activation)
        if own is None or robot not in self.robots or not self.problem.has_order:
            return []
        me, tasks = self.robots.index(robot), self.problem.tasks
        first = first_tasks(self.problem, self.schedule or ())
        if first.get(me) != number:
            return []
        found = []
        for other, task in enumerate(tasks):
            if not task.is_asked or (task.level, task.arrival) >= (own.level, own.arrival):
                continue
            if number is None:
                is_overtaken = could_begin(self.problem, self.dispatcher, first, other, me)
            else:
                lower, later, _ = overtaken(self.problem, self.dispatcher, first, other)
                is_overtaken = me in lower or me in later
            if is_overtaken:
                found.append(self.opens[other].request.activation)
        return found


def look_ahead(
    facts: TeamFacts, evaluation: Evaluation, demands: Sequence[Group], capabilities: Capabilities
) -> Lookahead:
    """The problem of this moment, and the schedule in force; `demands`: of the present requests."""
    found = _lookahead(facts, evaluation, demands, capabilities)
    travel = facts.mission.travel
    if not found.opens or travel is None or travel.horizon == 1:
        return found
    proposals = [(name, each) for name, each in sorted(facts.proposals.items()) if each.steps]
    if proposals:
        mended = ((found.mended(each), name) for name, each in proposals)
        best, author = min(mended, key=lambda each: (each[0].rank, each[0].schedule, each[1]))
    else:
        best, author = found.by_rules(), ""
    course = course_of(found.problem, best.schedule)
    return replace(found, schedule=best.schedule, course=course, author=author)


def by_schedule(mission: Mission, ahead: Lookahead, demands: Sequence[Group]) -> Sequence[Group]:
    """The demands of the requests, for the robots whose next step each of them is.

    Those robots are no candidates for requests that are left out, but for those that come first in
    the order of tasks, and for a preemptive one, which takes them from tasks further right also
    before they have begun.
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
        activation = group[0].request.activation
        step = ahead.step_of(activation)
        if step is None:
            is_preemptive = mission.global_tasks[group[0].request.subject].preemptive
            taken = {
                robot
                for robot, at in due.items()
                if at < index or not (is_preemptive or _comes_first(ahead, activation, robot))
            }
            result.append(tuple(_only(each, each.candidates.keys() - taken) for each in group))
            continue
        narrowed = []
        for demand, members in zip(group, step.crew, strict=True):
            robots = {name for r in members if due.get(name := ahead.robots[r]) == index}
            count = len(robots) + len(demand.pinned)
            narrowed.append(replace(_only(demand, robots), lower=count, upper=count))
        result.append(tuple(narrowed))
    return result


def _comes_first(ahead: Lookahead, activation: str, robot: str) -> bool:
    """Whether a request that is left out goes before the robot's next task: it has priority, or it
    came first, and the robot has not set out yet.
    """
    step, own = ahead.next_steps[robot], ahead.order.get(activation)
    other = ahead.problem.tasks[step.task]
    if own is None or own.level != other.level:
        return own is not None and own.level < other.level
    is_on_its_way = ahead.problem.under_way.get(ahead.robots.index(robot)) == step.task
    return own.arrival < other.arrival and not is_on_its_way


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
    requests = [each for found in rounds for each in found]
    order = task_order(facts, requests)
    known = {group[0].request.activation: group for group in demands}
    known_places = (r for r in facts.by_share(capabilities.team) if facts.place_of(r))
    numbers = {robot: number for number, robot in enumerate(known_places)}
    free_ms = dict.fromkeys(numbers, 0)
    ends_ms: dict[str, int] = {}
    opens: list[Open] = []
    left_out: dict[str, str] = {}
    at_work: set[str] = set()
    for request in requests:
        activation = request.activation
        group = known.get(activation) or request_demands(facts, request, capabilities, {})
        for demand in group:
            at_work.update(demand.pinned)
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
    tasks = _tasks(facts, opens, after, ends_ms, order, known, capabilities)
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
        frozenset(numbers[robot] for robot in at_work if robot in numbers),
        *_under_way(facts, opens, numbers),
    )
    return Lookahead(tuple(opens), tuple(numbers), problem, left_out, order)


def _need(mission: Mission, demand: Demand, numbers: Mapping[str, int]) -> SchedulingNeed:
    """What a demand still lacks."""
    able = demand.candidates.keys() - set(demand.pinned)
    work_ms = {numbers[r]: _work_ms(mission, demand, r) for r in sorted(able) if r in numbers}
    return SchedulingNeed(max(0, demand.lower - len(demand.pinned)), work_ms)


def _work_ms(mission: Mission, demand: Demand, robot: str) -> int:
    """How long a robot works on a local task, by its performance."""
    return -(-mission.nominal_work(demand.local_task) * 1_000 // demand.candidates[robot])


def _tasks(
    facts: TeamFacts,
    opens: Sequence[Open],
    after: Mapping[str, tuple[str, ...]],
    ends_ms: Mapping[str, int],
    order: Mapping[str, OrderKey],
    asked: Collection[str],
    capabilities: Capabilities,
) -> tuple[SchedulingTask, ...]:
    travel, tasks = facts.mission.travel, facts.mission.global_tasks
    assert travel is not None
    places = {name: number for number, name in enumerate(travel.places)}
    numbers = {each.request.activation: number for number, each in enumerate(opens)}
    unix_ms = _unix_ms(facts, capabilities)
    # The deadline of a job is that of its last tasks.
    followed = {name for each in opens for name in after.get(each.request.activation, ())}
    found = []
    for each in opens:
        activation = each.request.activation
        before, place = after.get(activation, ()), order[activation]
        goal = travel.at.get(each.group[0].local_task)
        deadline_ms = None
        if unix_ms and place.deadline_us and activation not in followed:
            deadline_ms = place.deadline_us // 1_000 - unix_ms
        found.append(
            SchedulingTask(
                None if goal is None else places[goal],
                each.needs,
                tuple(numbers[name] for name in before if name in numbers),
                tasks[each.request.subject].joint is not None,
                max((ends_ms.get(name, 0) for name in before), default=0),
                place.level,
                place.arrival,
                max(0, travel.overtaking - facts.overtaken(activation)),
                activation in asked,
                deadline_ms,
            )
        )
    return tuple(found)


def _unix_ms(facts: TeamFacts, capabilities: Capabilities) -> int:
    """What time it is: of the living robots that have written it the median, of an even number the
    earlier one in the middle. 0 if none has.
    """
    times_us = sorted(
        each.unix_us for robot, each in facts.team_times.items() if robot in capabilities.team
    )
    return times_us[(len(times_us) - 1) // 2] // 1_000 if times_us else 0


def _under_way(
    facts: TeamFacts, opens: Sequence[Open], numbers: Mapping[str, int]
) -> tuple[Mapping[int, int], frozenset[int]]:
    """Robot -> the open task to which it has set out; and those that have turned round for it.

    Once a robot has arrived it still is on its way, if it has overtaken something for that.
    """
    tasks = {each.request.activation: number for number, each in enumerate(opens)}
    under_way, fixed = {}, set()
    for robot, number in numbers.items():
        claim, noted = facts.valid_claim(robot), facts.overtakings.get(robot)
        if claim is None or claim.activation not in tasks or claim.phase is Phase.RUNNING:
            continue
        is_noted = noted is not None and noted.begun == claim.activation
        if claim.phase is Phase.TRAVELLING or is_noted:
            under_way[number] = tasks[claim.activation]
            if noted is not None and is_noted and noted.has_turned:
                fixed.add(number)
    return under_way, frozenset(fixed)


def _way(facts: TeamFacts, travel: Travel, robot: str) -> tuple[int, Sequence[Sequence[int]]]:
    """Where a robot is, and its ways from there and between places.

    Of the way that it is on, as much is left as it has said last.
    """
    places = list(travel.places)
    at, goal = places.index(facts.place_of(robot)), facts.under_way(robot)
    table, noted = facts.travel_table(robot), facts.overtakings.get(robot)
    if not goal:
        return at, table
    claim, left_ms = facts.valid_claim(robot), MAX_MS
    if noted is not None and claim is not None and noted.begun == claim.activation:
        left_ms = noted.left_ms
    return len(places), [*table, ways_between(table, at, places.index(goal), left_ms)]


def _why_left_out(mission: Mission, request: Request, needs: Sequence[SchedulingNeed]) -> str:
    """Why a task is none for a schedule; empty if it is."""
    task, travel = mission.global_tasks[request.subject], mission.travel
    assert travel is not None
    if mission.limits is not None:
        return f"the mission has {mission.limits.name}"
    if request.node in mission.entries.guards:
        return "it depends on conditions that every robot has for itself"
    if task.joint is not None and (reason := task.joint.why_unscheduled):
        return reason
    if task.preemptive:
        return "it takes robots from other tasks"
    if why := next(filter(None, (s.why_unscheduled(task) for s in mission.plan_steps)), ""):
        return why
    if any(need.same_robot_as is not None for need in task.needs):
        return "it asks for a robot that did something before"
    if any(need.min_robots == 0 for need in task.needs):
        return "it has helpers that nobody waits for"
    if len({travel.at.get(need.local_task) for need in task.needs}) > 1:
        return "its local tasks are at several places"
    return "" if can_be_served(needs) else "it lacks robots"
