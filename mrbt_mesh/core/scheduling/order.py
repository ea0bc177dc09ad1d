"""The order of tasks in schedules: priority first, then arrival, with bounded overtaking.

A task is *overtaken* when a robot that could do it begins a later one, while it is asked for and
lacks robots that could begin it. Tasks of lower levels never overtake, later ones of the same level
do as long as it has some to spare. A schedule that breaks this is mended: the task goes to the
front, to those of the robots that would overtake it, or are idle, with which it ends earliest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mrbt_mesh.core.scheduling.dispatch import Dispatched, Dispatcher
from mrbt_mesh.core.scheduling.problem import Crew, SchedulingProblem, Step, turning

NO_DEADLINE_MS = 1 << 62


def by_rules(problem: SchedulingProblem, dispatcher: Dispatcher) -> list[Dispatched]:
    """Schedules that need no search: each task in turn takes the robots with which it ends
    earliest, of all, or first of those that can begin it now. The turn is that of the order of
    tasks, and within a level also that of deadlines.
    """
    orders = [problem.in_order]
    if problem.has_deadlines:
        orders.append(tuple(sorted(problem.in_order, key=_by_deadline(problem).__getitem__)))
    hints = {goal: hint for goal in problem.in_order if (hint := _under_way_to(problem, goal, ()))}
    return [
        found
        for order in orders
        for found in (
            in_order(problem, dispatcher, order, hints),
            _at_once(problem, dispatcher, order, hints),
        )
    ]


def _by_deadline(problem: SchedulingProblem) -> list[tuple[int, int]]:
    return [
        (task.level, NO_DEADLINE_MS if task.deadline_ms is None else task.deadline_ms)
        for task in problem.tasks
    ]


def _at_once(
    problem: SchedulingProblem,
    dispatcher: Dispatcher,
    order: Sequence[int],
    hints: Mapping[int, Crew],
) -> Dispatched:
    """Robots that can begin something do. Those on their way turn round only for priority."""
    tasks, begun = problem.tasks, dict[int, Crew]()
    idle = set(range(len(problem.free_ms))) - problem.at_work
    for number in order:
        task = tasks[number]
        if not task.is_asked:
            continue
        own = hints.get(number, ((),) * len(task.needs))
        held = [
            robot
            for robot, goal in problem.under_way.items()
            if goal != number and tasks[goal].level <= task.level
        ]
        own = tuple(tuple(r for r in robots if r in idle) for robots in own)
        crew = dispatcher.crew(number, idle.difference(held), own)
        if crew is not None:
            begun[number] = crew
            idle.difference_update(_robots(crew))
    # A robot that another task has taken is no hint any more.
    taken = {robot for crew in begun.values() for robot in _robots(crew)}
    for number, own in hints.items():
        if number not in begun:
            begun[number] = tuple(tuple(r for r in robots if r not in taken) for robots in own)
    first = [number for number in order if number in begun]
    rest = [number for number in order if number not in begun]
    return in_order(problem, dispatcher, first + rest, begun)


def mended(
    problem: SchedulingProblem,
    dispatcher: Dispatcher,
    order: Sequence[int],
    hints: Mapping[int, Crew],
) -> Dispatched:
    """What robots make of these tasks in this order: `in_order`, for which nobody turns round that
    has done so before.
    """
    found = in_order(problem, dispatcher, order, hints)
    if problem.fixed & turning(problem, found.schedule):
        found = _onward(problem, dispatcher, order, hints)
    return found


def _onward(
    problem: SchedulingProblem,
    dispatcher: Dispatcher,
    order: Sequence[int],
    hints: Mapping[int, Crew],
) -> Dispatched:
    """`in_order`, with what robots that are fixed have set out for at the front."""
    goals = {problem.under_way[robot] for robot in problem.fixed}
    first = {goal: _under_way_to(problem, goal, ()) for goal in problem.in_order if goal in goals}
    kept = {goal: crew for goal, crew in first.items() if crew is not None}
    return in_order(problem, dispatcher, [*kept, *order], {**hints, **kept})


def in_order(
    problem: SchedulingProblem,
    dispatcher: Dispatcher,
    order: Sequence[int],
    hints: Mapping[int, Crew],
) -> Dispatched:
    """The schedule of these tasks in this order, as far as the order of tasks allows it; those that
    are missing come last. `hints`: as `Dispatcher.dispatch` takes them.
    """
    tasks, wanted = problem.tasks, dict.fromkeys(order)  # each once
    found = dispatcher.dispatch([*wanted, *(n for n in problem.in_order if n not in wanted)], hints)
    if not problem.has_order:
        return found
    asked = [number for number in problem.in_order if tasks[number].is_asked]
    front: dict[int, Crew] = {}
    first = first_tasks(problem, found.schedule)
    latest = _latest(problem, first)
    # What is mended may be what makes another one possible.
    for _ in asked:
        is_mended = False
        for number in asked:
            if latest is None or not tasks[number].is_before(tasks[latest]):
                break  # nor does a robot overtake those that are later
            crew = _overdue(problem, dispatcher, first, number)
            if crew is not None and front.get(number) != crew:
                front[number], is_mended = crew, True
                steps = [Step(each, front[each]) for each in asked if each in front]
                steps += [step for step in found.schedule if step.task not in front]
                first = first_tasks(problem, steps)
                latest = _latest(problem, first)
        if not is_mended:
            break
    if not front:
        return found
    return dispatcher.dispatch(
        [step.task for step in steps], {step.task: step.crew for step in steps}
    )


def overtakers(
    problem: SchedulingProblem, first: Mapping[int, int], number: int
) -> tuple[list[int], list[int]]:
    """The robots that would overtake a task: those whose next task is of less priority, and those
    that would begin a later one of its level now. `first`: robot -> the asked task that is next.
    """
    task = problem.tasks[number]
    needs = [need for need in task.needs if need.robots]
    lower, later = [], []
    for robot, goal in sorted(first.items()):
        if not task.is_before(problem.tasks[goal]):
            continue
        if not any(robot in need.work_ms for need in needs):
            continue
        if problem.tasks[goal].level > task.level:
            lower.append(robot)
        elif problem.under_way.get(robot) != goal:
            later.append(robot)
    return lower, later


def first_tasks(problem: SchedulingProblem, steps: Iterable[Step]) -> dict[int, int]:
    """Robot that is not at work -> its first task, if that is asked for."""
    found: dict[int, int] = {}
    for number, crew in steps:
        for robot in _robots(crew):
            found.setdefault(robot, number)
    return {
        robot: number
        for robot, number in found.items()
        if robot not in problem.at_work and problem.tasks[number].is_asked
    }


def free_for(
    problem: SchedulingProblem, first: Mapping[int, int], number: int, overtaking: Iterable[int]
) -> set[int]:
    """The robots that could begin a task now: those that would overtake it, those that have nothing
    to begin, and those that are to begin it.
    """
    idle = set(range(len(problem.free_ms))) - problem.at_work - first.keys()
    idle = {
        robot
        for robot in idle
        if (goal := problem.under_way.get(robot, number)) == number
        or problem.tasks[goal].level > problem.tasks[number].level
    }
    return idle | set(overtaking) | {robot for robot, goal in first.items() if goal == number}


def overtaken(
    problem: SchedulingProblem, dispatcher: Dispatcher, first: Mapping[int, int], number: int
) -> tuple[list[int], list[int], set[int]]:
    """`overtakers` of a task that waits, and the robots with which it could begin; all empty if it
    does not wait, or could not begin.
    """
    if len(_next_for(first, number)) >= problem.tasks[number].robots:
        return [], [], set()
    lower, later = overtakers(problem, first, number)
    if not lower and not later:
        return [], [], set()
    free = free_for(problem, first, number, (*lower, *later))
    if dispatcher.crew(number, free) is None:
        return [], [], set()
    return lower, later, free


def could_begin(
    problem: SchedulingProblem,
    dispatcher: Dispatcher,
    first: Mapping[int, int],
    number: int,
    robot: int,
) -> bool:
    """Whether a task waits that could begin now if this robot, which begins something else, were
    free for it.
    """
    task = problem.tasks[number]
    is_able = any(need.robots and robot in need.work_ms for need in task.needs)
    if not is_able or len(_next_for(first, number)) >= task.robots:
        return False
    return dispatcher.crew(number, free_for(problem, first, number, [robot])) is not None


def _overdue(
    problem: SchedulingProblem, dispatcher: Dispatcher, first: Mapping[int, int], number: int
) -> Crew | None:
    """The robots that are to begin a task now, if others would overtake it that must not, or begin
    something of less priority where they are while it waits twice as long for robots on their way.
    """
    spare = problem.tasks[number].spare
    lower, later, free = overtaken(problem, dispatcher, first, number)
    is_later_allowed = spare is None or len(later) <= spare
    if not lower and is_later_allowed:
        return _sooner(problem, dispatcher, first, number)
    others = free.difference(later) if is_later_allowed else free
    own = _under_way_to(problem, number, others)
    return dispatcher.crew(number, others, own) or dispatcher.crew(number, free, own)


def _sooner(
    problem: SchedulingProblem, dispatcher: Dispatcher, first: Mapping[int, int], number: int
) -> Crew | None:
    """The robots for a task that has enough, if it ends in less than half the time with some that
    would begin one of less priority.
    """
    own = _next_for(first, number)
    if len(own) < problem.tasks[number].robots:
        return None
    half_ms = _end_ms(problem, number, own) // 2
    lower, _ = overtakers(problem, first, number)
    lower = [
        robot
        for robot in lower
        if robot not in problem.under_way and _end_ms(problem, number, [robot]) < half_ms
    ]
    crew = dispatcher.crew(number, {*own, *lower}) if lower else None
    return crew if crew is not None and _end_ms(problem, number, _robots(crew)) < half_ms else None


def _end_ms(problem: SchedulingProblem, number: int, robots: Iterable[int]) -> int:
    """When a task ends if these robots are on their way to it."""
    task, there_ms, work_ms = problem.tasks[number], [0], [0]
    for robot in robots:
        ways_ms = problem.travel_ms[robot][problem.at[robot]]
        way_ms = 0 if task.place is None else ways_ms[task.place]
        there_ms.append(way_ms)
        work_ms.append(min(need.work_ms[robot] for need in task.needs if robot in need.work_ms))
    if task.is_together:
        return max(there_ms) + max(work_ms)
    return max(map(sum, zip(there_ms, work_ms, strict=True)))


def _latest(problem: SchedulingProblem, first: Mapping[int, int]) -> int | None:
    """Of the tasks that are next the one that is last in the order of tasks."""
    tasks = problem.tasks
    return max(
        first.values(), key=lambda goal: (tasks[goal].level, tasks[goal].arrival), default=None
    )


def _next_for(first: Mapping[int, int], number: int) -> list[int]:
    """The robots whose next task this is."""
    return [robot for robot, goal in first.items() if goal == number]


def _under_way_to(problem: SchedulingProblem, number: int, among: Iterable[int]) -> Crew | None:
    """The robots that have set out to a task, for its needs; None if there are none."""
    robots = sorted(robot for robot, goal in problem.under_way.items() if goal == number)
    if among:
        robots = [robot for robot in robots if robot in set(among)]
    found = []
    for need in problem.tasks[number].needs:
        own = [robot for robot in robots if robot in need.work_ms][: need.robots]
        robots = [robot for robot in robots if robot not in own]
        found.append(tuple(own))
    return tuple(found) if any(found) else None


def _robots(crew: Crew) -> list[int]:
    return [robot for robots in crew for robot in robots]
