"""From an order of tasks to a schedule: each task in turn takes the robots that suit it best.

A serial schedule generation scheme (Kolisch, 1996): every order leads to a schedule that can be
carried out. So a search looks through orders, and crews follow.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple, TypeAlias

from mrbt_mesh.core.scheduling.problem import (
    Crew,
    Rank,
    Schedule,
    SchedulingNeed,
    SchedulingProblem,
    Step,
    value_of,
)


class Dispatched(NamedTuple):
    """The schedule that an order leads to, its cost, and its rank."""

    schedule: Schedule
    cost: int
    rank: Rank


# What a robot could do for a task: (when it would end, when it is there, robot).
Offer: TypeAlias = tuple[int, int, int]
_NEVER_MS = 1 << 62
_THERE_MS, _ROBOT = itemgetter(1), itemgetter(2)
_NO_HINTS: Mapping[int, Crew] = {}


class Dispatcher:
    """Turns orders of a problem's tasks into schedules.

    `dispatch` raises ValueError where tasks lack robots, or are after one another in a circle.
    """

    def __init__(self, problem: SchedulingProblem) -> None:
        self._problem = problem
        self._needs = [
            [(need.robots, sorted(need.work_ms.items())) for need in task.needs]
            for task in problem.tasks
        ]
        # Whether some robot could serve several needs of the task.
        self._overlap = [
            len({robot for need in task.needs for robot in need.work_ms})
            < sum(len(need.work_ms) for need in task.needs)
            for task in problem.tasks
        ]
        self._is_simple = [
            task.is_together
            and not overlaps
            and all(need.robots == 1 and need.work_ms for need in task.needs)
            for task, overlaps in zip(problem.tasks, self._overlap, strict=True)
        ]
        self._has_precedence = any(task.after for task in problem.tasks)
        # Of each robot: when it is free, where it is then, and its ways from there.
        self._free_ms: list[int] = []
        self._at: list[int] = []
        self._ways_ms: list[Sequence[int]] = []
        self._begin()

    def _begin(self) -> None:
        problem = self._problem
        self._free_ms = list(problem.free_ms)
        self._at = list(problem.at)
        self._ways_ms = [problem.travel_ms[robot][place] for robot, place in enumerate(self._at)]

    def dispatch(self, order: Sequence[int], hints: Mapping[int, Crew] = _NO_HINTS) -> Dispatched:
        """Give robots to each task, in this order; a task after others has its turn after them.

        A task takes the robots with which it ends earliest, and of those for whom that makes no
        difference the ones that arrive last: they wait least. `hints`: task -> for each need robots
        that it takes in any case, no more than it needs.
        """
        problem = self._problem
        travel_ms, tasks, is_simple = problem.travel_ms, problem.tasks, self._is_simple
        self._begin()
        free_ms, at, ways_ms = self._free_ms, self._at, self._ways_ms
        ended_ms: dict[int, int] = {}
        steps = []
        for number in self._feasible(order) if self._has_precedence else order:
            task = tasks[number]
            leaves_ms = task.ready_ms
            for each in task.after:
                leaves_ms = max(leaves_ms, ended_ms[each])
            place = task.place
            hint = hints.get(number)
            if hint is None and is_simple[number]:
                crew, begin_ms, works_ms = self._gather(number, leaves_ms)
                for (robot,), work_ms in zip(crew, works_ms, strict=True):
                    free_ms[robot] = begin_ms + work_ms
                last_ms = begin_ms + max(works_ms)
            else:
                if hint is None:
                    chosen = self._choose(number, leaves_ms)
                else:
                    chosen = self._completed(number, leaves_ms, hint)
                begin_ms = last_ms = 0
                if task.is_together:
                    begin_ms = max([each[1] for offers in chosen for each in offers])
                for offers in chosen:
                    for end_ms, there_ms, robot in offers:
                        free_ms[robot] = own_ms = end_ms + max(0, begin_ms - there_ms)
                        last_ms = max(last_ms, own_ms)
                crew = tuple([tuple(map(_ROBOT, offers)) for offers in chosen])
            if place is not None:
                for robots in crew:
                    for robot in robots:
                        at[robot], ways_ms[robot] = place, travel_ms[robot][place]
            ended_ms[number] = last_ms
            steps.append(Step(number, crew))
        return Dispatched(tuple(steps), *value_of(problem, steps, free_ms, at, ended_ms))

    def crew(self, number: int, robots: Collection[int], hint: Crew | None = None) -> Crew | None:
        """The robots, of these, with which a task ends earliest if they set out for it now, among
        them those of the hint; None if they are too few.
        """
        self._begin()
        try:
            chosen = self._completed(number, 0, hint or ((),) * len(self._needs[number]), robots)
        except ValueError:
            return None
        return tuple(tuple(map(_ROBOT, offers)) for offers in chosen)

    def _completed(
        self, number: int, leaves_ms: int, hint: Crew, among: Collection[int] | None = None
    ) -> list[list[Offer]]:
        """`_choose` with some robots given, and others only of those in `among`."""
        needs, given = self._needs[number], {robot for robots in hint for robot in robots}
        every = [self._offers(number, able, leaves_ms) for _, able in needs]
        chosen = [
            [offer for offer in offers if offer[2] in robots]
            for offers, robots in zip(every, hint, strict=True)
        ]
        counts = [count - len(own) for (count, _), own in zip(needs, chosen, strict=True)]
        if any(counts):
            others = [
                sorted(
                    offer
                    for offer in offers
                    if offer[2] not in given and (among is None or offer[2] in among)
                )
                for offers in every
            ]
            found = match(others, counts)
            if found is None and given:
                # One of them may be the only one for another need.
                return self._completed(number, leaves_ms, ((),) * len(needs), among)
            if found is None:
                raise ValueError(f"task {number} lacks robots")
            chosen = [own + more for own, more in zip(chosen, found, strict=True)]
        return chosen

    def _gather(self, number: int, leaves_ms: int) -> tuple[Crew, int, list[int]]:
        """`_choose` for robots that gather, one for each need; when the task begins, and for how
        long each robot works.
        """
        free_ms, ways_ms, place = self._free_ms, self._ways_ms, self._problem.tasks[number].place
        every = []
        gathered_ms = longest_ms = 0
        for _, able in self._needs[number]:
            arrivals, first_ms, first_there_ms = [], _NEVER_MS, 0
            for robot, work_ms in able:
                there_ms = free_ms[robot]
                if there_ms < leaves_ms:
                    there_ms = leaves_ms
                if place is not None:
                    there_ms += ways_ms[robot][place]
                arrivals.append(there_ms)
                if there_ms + work_ms < first_ms or (
                    there_ms + work_ms == first_ms and there_ms < first_there_ms
                ):
                    first_ms, first_there_ms, first_work_ms = there_ms + work_ms, there_ms, work_ms
            gathered_ms = max(gathered_ms, first_there_ms)
            longest_ms = max(longest_ms, first_work_ms)
            every.append(arrivals)
        crew, works_ms, begin_ms = [], [], 0
        for (_, able), arrivals in zip(self._needs[number], every, strict=True):
            latest_ms = -1
            for (robot, work_ms), there_ms in zip(able, arrivals, strict=True):
                if latest_ms < there_ms <= gathered_ms and work_ms <= longest_ms:
                    latest_ms, chosen, chosen_work_ms = there_ms, robot, work_ms
            begin_ms = max(begin_ms, latest_ms)
            works_ms.append(chosen_work_ms)
            crew.append((chosen,))
        return tuple(crew), begin_ms, works_ms

    def _choose(self, number: int, leaves_ms: int) -> list[list[Offer]]:
        """For each need of a task the offers that it takes, of robots that may leave by then."""
        needs = self._needs[number]
        every = [self._offers(number, able, leaves_ms) for _, able in needs]
        counts = [count for count, _ in needs]
        if self._overlap[number]:
            found = match([sorted(offers) for offers in every], counts)
            if found is None:
                raise ValueError(f"task {number} lacks robots")
            return found
        there_ms = work_ms = 0
        chosen: list[list[Offer]] = []
        for count, offers in zip(counts, every, strict=True):
            if len(offers) < count:
                raise ValueError(f"task {number} lacks robots")
            first = [min(offers)] if count == 1 else sorted(offers)[:count]
            for offer in first:
                there_ms = max(there_ms, offer[1])
                work_ms = max(work_ms, offer[0] - offer[1])
            chosen.append(first)
        if not self._problem.tasks[number].is_together:
            return chosen
        return [
            _arriving_last(offers, count, there_ms, work_ms)
            for count, offers in zip(counts, every, strict=True)
        ]

    def _offers(self, number: int, able: Sequence[tuple[int, int]], leaves_ms: int) -> list[Offer]:
        place = self._problem.tasks[number].place
        free_ms, ways_ms = self._free_ms, self._ways_ms
        offers = []
        for robot, work_ms in able:
            there_ms = free_ms[robot]
            if there_ms < leaves_ms:
                there_ms = leaves_ms
            if place is not None:
                there_ms += ways_ms[robot][place]
            offers.append((there_ms + work_ms, there_ms, robot))
        return offers

    def _feasible(self, order: Sequence[int]) -> list[int]:
        """The order, with each task behind those that it is after."""
        tasks, waiting, found = self._problem.tasks, list(order), list[int]()
        done = set[int]()
        while waiting:
            ready = [each for each in waiting if done.issuperset(tasks[each].after)]
            if not ready:
                raise ValueError(f"tasks {waiting} are after one another in a circle")
            waiting.remove(ready[0])
            done.add(ready[0])
            found.append(ready[0])
        return found


def can_be_served(needs: Sequence[SchedulingNeed]) -> bool:
    """Whether there are robots enough, of which none serves two needs."""
    every = [[(0, 0, robot) for robot in sorted(need.work_ms)] for need in needs]
    return match(every, [need.robots for need in needs]) is not None


def match(every: Sequence[Sequence[Offer]], counts: Sequence[int]) -> list[list[Offer]] | None:
    """Offers for needs of which some robots could serve several, the first ones where possible;
    None if they are too few. By augmenting paths (Kuhn, 1955).
    """
    holders: dict[int, tuple[int, Offer]] = {}

    def place(need: int, tried: set[int]) -> bool:
        for offer in every[need]:
            robot = offer[2]
            if robot not in tried:
                tried.add(robot)
                if robot not in holders or place(holders[robot][0], tried):
                    holders[robot] = need, offer
                    return True
        return False

    # Needs that fewer robots can serve have their turn earlier.
    for need in sorted(range(len(every)), key=lambda need: len(every[need])):
        if not all(place(need, set()) for _ in range(counts[need])):
            return None
    chosen: list[list[Offer]] = [[] for _ in every]
    for need, offer in holders.values():
        chosen[need].append(offer)
    return [sorted(offers) for offers in chosen]


def _arriving_last(offers: Sequence[Offer], count: int, there_ms: int, work_ms: int) -> list[Offer]:
    """Of the robots that neither delay the work nor make it longer, those that arrive last."""
    fitting = [each for each in offers if each[1] <= there_ms and each[0] - each[1] <= work_ms]
    if count == 1:
        return [max(fitting, key=_THERE_MS)]
    return sorted(fitting, key=_THERE_MS, reverse=True)[:count]
