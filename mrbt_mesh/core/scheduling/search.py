"""The search for a good order: threshold accepting (Dueck and Scheuer, 1990).

It begins with the best of some priority rules, and then moves one task or exchanges two, as local
search for vehicle routing does. A worse order is accepted while it is not worse by more than a
threshold, which falls to nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mrbt_mesh.core.scheduling.dispatch import Dispatched, Dispatcher
from mrbt_mesh.core.scheduling.problem import SchedulingProblem, SchedulingTask

# The first threshold, as a part of the cost: the best of 1/50 to 1/400 on published cases.
THRESHOLD_PART = 80


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
    orders = [*_by_rules(problem), *([list(known)] if known else [])]
    best = min((dispatcher.dispatch(order) for order in orders), key=lambda found: found.rank)
    yield best
    count = len(problem.tasks)
    if count < 2:
        return
    order, rank = [step.task for step in best.schedule], best.rank
    first_threshold, numbers = rank.cost // THRESHOLD_PART, _numbers(seed)
    for left in range(evaluations, 0, -1):
        take, place = next(numbers) % count, next(numbers) % count
        changed = order.copy()
        if next(numbers) % 2:
            changed.insert(place, changed.pop(take))
        else:
            changed[take], changed[place] = changed[place], changed[take]
        found = dispatcher.dispatch(changed)
        threshold = first_threshold * left // evaluations
        if found.rank <= rank._replace(cost=rank.cost + threshold):
            order, rank = changed, found.rank
            if rank < best.rank:
                best = found
        yield best


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
