"""The search for a good order: threshold accepting (Dueck and Scheuer, 1990).

It begins with the best of some priority rules, and then moves one task or exchanges two, as local
search for vehicle routing does, or gives a task a robot that it would not take by itself. What is
worse is accepted while it is not worse by more than a threshold, which falls to nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TypeAlias

from mrbt_mesh.core.scheduling.dispatch import Dispatched, Dispatcher
from mrbt_mesh.core.scheduling.order import mended
from mrbt_mesh.core.scheduling.problem import Crew, SchedulingProblem, SchedulingTask

# The first threshold, as a part of the cost: the best of 1/50 to 1/400 on published cases.
THRESHOLD_PART = 80
Dispatch: TypeAlias = Callable[[Sequence[int], Mapping[int, Crew]], Dispatched]
# Of so few tasks all orders that matter are soon tried. Then it is also changed who does them, with
# a threshold by which random missions of six tasks came closest to the best schedule. Where tasks
# arrive one by one and have an order, robots turned to and fro by such schedules.
FEW_TASKS, THRESHOLD_PART_OF_FEW = 8, 5


def search(
    problem: SchedulingProblem, evaluations: int, seed: int, known: Sequence[int] = ()
) -> Dispatched:
    """The best schedule found with this number of orders beyond those of the priority rules.

    `known`: an order to begin with, if it is better. Raises ValueError as `Dispatcher` does.
    """
    *_, best = search_steps(problem, evaluations, seed, known)
    return best


def search_steps(
    problem: SchedulingProblem, evaluations: int, seed: int, known: Sequence[int] = ()
) -> Iterator[Dispatched]:
    """`search`, with the best schedule so far after each order."""
    dispatcher = Dispatcher(problem)
    # What counts is what robots make of a proposal.
    allowed = partial(mended, problem, dispatcher)
    orders = [*_by_rules(problem), *([list(known)] if known else [])]
    best = min((allowed(order, {}) for order in orders), key=lambda found: found.rank)
    yield best
    count = len(problem.tasks)
    if count < 2:
        return
    are_few = count <= FEW_TASKS and not problem.has_order
    dispatch = _remembered(dispatcher.dispatch) if are_few else dispatcher.dispatch
    numbers = _numbers(seed)
    phases = ((THRESHOLD_PART, False), (THRESHOLD_PART_OF_FEW, True))
    for part, are_robots_changed in phases if are_few else phases[:1]:
        order, rank = [step.task for step in best.schedule], best.rank
        given, first_threshold = dict[int, Crew](), rank.cost // part
        for left in range(evaluations, 0, -1):
            changed, changed_given = order, given
            if are_robots_changed and next(numbers) % 2:
                changed_given = _otherwise(problem.tasks, given, numbers)
            else:
                changed = _changed(order, numbers)
            found = dispatch(changed, changed_given)
            limit = rank._replace(cost=rank.cost + first_threshold * left // evaluations)
            if problem.has_order and found.rank <= limit:
                # Orders that are too bad as they are need not be mended.
                found = allowed(changed, changed_given)
                changed = [step.task for step in found.schedule]
            if found.rank <= limit:
                order, given, rank = changed, changed_given, found.rank
                if rank < best.rank:
                    best = found
            yield best


def _remembered(dispatch: Dispatch) -> Dispatch:
    """The same, which computes nothing twice: few tasks have few orders, which come again."""
    known: dict[tuple[object, ...], Dispatched] = {}

    def found_before(order: Sequence[int], given: Mapping[int, Crew]) -> Dispatched:
        key = (*order, *sorted(given.items()))
        found = known.get(key)
        if found is None:
            found = known[key] = dispatch(order, given)
        return found

    return found_before


def _changed(order: Sequence[int], numbers: Iterator[int]) -> list[int]:
    """An order with one task moved or two exchanged."""
    changed, count = list(order), len(order)
    take, place = next(numbers) % count, next(numbers) % count
    if next(numbers) % 2:
        changed.insert(place, changed.pop(take))
    else:
        changed[take], changed[place] = changed[place], changed[take]
    return changed


def _otherwise(
    tasks: Sequence[SchedulingTask], given: Mapping[int, Crew], numbers: Iterator[int]
) -> dict[int, Crew]:
    """`given`, the robots that tasks take in any case, with another one for a need of some task; or
    with none for that task, if it has that robot.
    """
    number = next(numbers) % len(tasks)
    needs = tasks[number].needs
    index = next(numbers) % len(needs)
    changed, need = dict(given), needs[index]
    crew = changed.pop(number, ((),) * len(needs))
    if not need.robots:
        return changed
    able = sorted(need.work_ms)
    robot = able[next(numbers) % len(able)]
    if not any(robot in robots for robots in crew):
        own = (*crew[index], robot)[-need.robots :]
        changed[number] = (*crew[:index], own, *crew[index + 1 :])
    return changed


def _by_rules(problem: SchedulingProblem) -> list[list[int]]:
    """Orders of all tasks by priority rules: long work, many robots, long ways first."""
    tasks = problem.tasks
    work_ms = [_longest_ms(task) for task in tasks]
    robots = [sum(need.robots for need in task.needs) for task in tasks]
    way_ms = [_way_ms(problem, task) for task in tasks]
    rules = (
        [-work for work in work_ms],
        [-count for count in robots],
        [-way for way in way_ms],
        way_ms,
        [-way - work for way, work in zip(way_ms, work_ms, strict=True)],
        [-count * (work + way) for count, work, way in zip(robots, work_ms, way_ms, strict=True)],
    )
    return [sorted(range(len(tasks)), key=rule.__getitem__) for rule in rules]


def _longest_ms(task: SchedulingTask) -> int:
    return max(min(need.work_ms.values(), default=0) for need in task.needs)


def _way_ms(problem: SchedulingProblem, task: SchedulingTask) -> int:
    """The longest way to a task of a robot that can do it."""
    goal = task.place
    if goal is None:
        return 0
    able = {robot for need in task.needs for robot in need.work_ms}
    return max((problem.travel_ms[r][problem.at[r]][goal] for r in sorted(able)), default=0)


def _numbers(seed: int) -> Iterator[int]:
    """Pseudo-random numbers of 53 bits: xorshift64 (Marsaglia, 2003)."""
    mask = (1 << 64) - 1
    state = (seed * 0x9E3779B97F4A7C15 + 0x2545F4914F6CDD1D) & mask or 1
    while True:
        state ^= state << 13 & mask
        state ^= state >> 7
        state ^= state << 17 & mask
        yield state >> 11
