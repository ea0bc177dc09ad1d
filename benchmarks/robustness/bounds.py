"""What the draws allow: with hindsight, and without."""

from __future__ import annotations

from itertools import combinations

from ortools.graph.python.max_flow import SimpleMaxFlow

from benchmarks.robustness.draws import ACTIONS, Draw, before

Choice = tuple[int, int]


def allows(draw: Draw) -> bool:
    """Whether any team at all could have succeeded with this draw.

    That is so if and only if every action can be given to a capable robot such that robot i gets
    at most lives[i] of them. A team that succeeded has done so. Conversely, let the robots do
    what they were given one action at a time, rooms first: each lives until it has completed its
    last one, and no action comes before what it needs. So the order takes nothing away.
    """
    flow = SimpleMaxFlow()
    source, sink = ACTIONS + len(draw.lives), ACTIONS + len(draw.lives) + 1
    for action, able in enumerate(draw.able):
        flow.add_arc_with_capacity(source, action, 1)
        for robot in sorted(able):
            flow.add_arc_with_capacity(action, ACTIONS + robot, 1)
    for robot, actions in enumerate(draw.lives):
        flow.add_arc_with_capacity(ACTIONS + robot, sink, actions)
    status = flow.solve(source, sink)
    if status != flow.OPTIMAL:
        raise RuntimeError(f"max flow ended with status {status.name}")
    return bool(flow.optimal_flow() == ACTIONS)


class BestPolicy:
    """The best that can be done without knowing how long robots live, by dynamic programming.

    A state is the set of completed actions and the set of living robots, both as bits. Lives are
    geometric, so the number of past actions does not matter. One action at a time is enough: to
    start two at once is only to decide the second before the first one's end is known, and time
    does not count.
    """

    def __init__(self, able: tuple[frozenset[int], ...], robots: int, fault: int) -> None:
        self._able = able
        self._robots = robots
        self._fault = fault / 100
        self._start = (1 << robots) - 1
        self._values: list[dict[int, float]] = [{} for _ in range(self._start + 1)]
        self._choices: dict[tuple[int, int], Choice] = {}
        for done in _ideals():
            for alive in range(self._start + 1):
                self._solve(done, alive)

    @property
    def chance(self) -> float:
        """The probability of success."""
        return self._values[self._start][0]

    def choice(self, done: int, alive: int) -> Choice | None:
        """(action, robot) to do next; None if nothing can lead to success any more."""
        return self._choices.get((done, alive))

    def _solve(self, done: int, alive: int) -> None:
        if done == (1 << ACTIONS) - 1:
            self._values[alive][done] = 1.0
            return
        best = 0.0
        for action in possible(done):
            after = done | 1 << action
            lives = self._values[alive][after]
            for robot in sorted(self._able[action]):
                if alive >> robot & 1:
                    dies = self._values[alive & ~(1 << robot)][after]
                    value = (1 - self._fault) * lives + self._fault * dies
                    if value > best:
                        best = value
                        self._choices[done, alive] = (action, robot)
        self._values[alive][done] = best

    def succeeds(self, draw: Draw) -> bool:
        """What becomes of a draw under this policy."""
        lives = list(draw.lives)
        done, alive = 0, self._start
        while done != (1 << ACTIONS) - 1:
            choice = self.choice(done, alive)
            if choice is None:
                return False
            action, robot = choice
            done |= 1 << action
            lives[robot] -= 1
            if not lives[robot]:
                alive &= ~(1 << robot)
        return True


def possible(done: int) -> list[int]:
    """The actions that are open: not completed, and what comes before them is."""
    return [
        action
        for action in range(ACTIONS)
        if not done >> action & 1 and all(done >> earlier & 1 for earlier in before(action))
    ]


def _ideals() -> list[int]:
    """The sets of completed actions that can come up, larger ones first."""
    sets = []
    for size in range(ACTIONS, -1, -1):
        for chosen in combinations(range(ACTIONS), size):
            if all(earlier in chosen for action in chosen for earlier in before(action)):
                sets.append(sum(1 << action for action in chosen))
    return sets
