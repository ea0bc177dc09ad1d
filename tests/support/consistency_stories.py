"""Random stories of a team: what *Check Consistency* is asked after each event.

Groups of demands that an event leaves as they are stay
the same objects, as a planner would leave them; at times they are equal but other objects.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.demands import Demand
from tests.support.build import World, action, make_mission, parallel, task

TASKS = ("calm", "grabbing")


def facts() -> TeamFacts:
    """Of a mission with two tasks: `grabbing` is preemptive."""
    tree = parallel(2, *(action(name) for name in TASKS))
    tasks = [task(name, preemptive=name == "grabbing") for name in TASKS]
    return World(make_mission(tree, {}, tasks)).facts


WORKER = Worker("", Member("T", {}, {}, False, "", "", 0), Incarnation(1, "n"))


@dataclass
class Wish:
    """One local task of a request: who can do it, how many are needed, who runs it."""

    kind: str
    lower: int
    ended: set[str] = field(default_factory=set)
    pinned: list[str] = field(default_factory=list)
    narrowed: set[str] | None = None


@dataclass
class Asked:
    """A request of the story."""

    number: int
    subject: str
    wishes: list[Wish]
    excluded: bool = False
    group: list[Demand] = field(default_factory=list)


@dataclass(frozen=True)
class Sizes:
    """How large a story is: `kinds` of local tasks, of which a robot can do each by chance."""

    robots: int
    requests: int
    kinds: int
    chance: float
    most_needed: int = 3
    most_wishes: int = 3
    grabbing: float = 0.0
    pins: float = 0.5


class Story:
    """A team, its requests, and one event after the other."""

    def __init__(self, seed: int, sizes: Sizes) -> None:
        self._random = random.Random(seed)
        self.sizes = sizes
        self.kinds = [f"k{number}" for number in range(sizes.kinds)]
        self.robots = [f"r{number}" for number in range(sizes.robots)]
        self.able = {robot: self._abilities() for robot in self.robots}
        self.alive = set(self.robots)
        self._count = 0
        self.requests = [self._request() for _ in range(sizes.requests)]
        for _ in range(round(sizes.pins * sizes.robots)):
            self.pin()

    def _abilities(self) -> set[str]:
        return {kind for kind in self.kinds if self._random.random() < self.sizes.chance}

    def _request(self) -> Asked:
        draw, sizes = self._random, self.sizes
        self._count += 1
        kinds = draw.sample(self.kinds, draw.randint(1, min(sizes.most_wishes, len(self.kinds))))
        wishes = [Wish(kind, draw.randint(1, sizes.most_needed)) for kind in kinds]
        return Asked(self._count, TASKS[draw.random() < sizes.grabbing], wishes)

    # -- what is asked ------------------------------------------------------------------------

    @property
    def team(self) -> dict[str, Worker]:
        return {robot: WORKER for robot in self.robots if robot in self.alive}

    @property
    def excluded(self) -> list[int]:
        return [index for index, asked in enumerate(self.requests) if asked.excluded]

    def groups(self, fresh: float = 0.05) -> list[list[Demand]]:
        """The demands now; with this chance a group is another object though nothing changed."""
        found = []
        shared: dict[str, dict[str, int]] = {}
        for asked in self.requests:
            group = [self._demand(asked, wish, shared) for wish in asked.wishes]
            if group != asked.group or self._random.random() < fresh:
                asked.group = group
            found.append(asked.group)
        return found

    def _demand(self, asked: Asked, wish: Wish, shared: dict[str, dict[str, int]]) -> Demand:
        if wish.kind not in shared:
            able = [r for r in self.robots if r in self.alive and wish.kind in self.able[r]]
            shared[wish.kind] = dict.fromkeys(able, 1)
        candidates: Mapping[str, int] = shared[wish.kind]
        if wish.ended or wish.narrowed is not None:
            allowed = self.alive if wish.narrowed is None else wish.narrowed
            candidates = {r: 1 for r in candidates if r in allowed and r not in wish.ended}
        pinned = tuple(robot for robot in wish.pinned if robot in candidates)
        request = Request(asked.number, asked.subject, f"a{asked.number}")
        return Demand(request, wish.kind, wish.lower, wish.lower, 9, pinned, candidates)

    # -- events -------------------------------------------------------------------------------

    def step(self) -> str:
        """Something happens; returns what."""
        events: Sequence[Callable[[], None]] = (
            self.die,
            self.come,
            self.pin,
            self.pin,
            self.unpin,
            self.end,
            self.finish,
            self.ask,
            self.lose,
            self.exclude,
            self.narrow,
        )
        event = self._random.choice(events)
        event()
        return event.__name__

    def _wish(self) -> Wish | None:
        return (
            self._random.choice(self._random.choice(self.requests).wishes)
            if self.requests
            else None
        )

    def die(self) -> None:
        if self.alive:
            self.alive.discard(self._random.choice(sorted(self.alive)))

    def come(self) -> None:
        away = [robot for robot in self.robots if robot not in self.alive]
        if away:
            robot = self._random.choice(away)
            self.alive.add(robot)
            if self._random.random() < 0.3:
                self.able[robot] = self._abilities()

    def pin(self) -> None:
        """A robot begins to run something it can do."""
        wish = self._wish()
        busy = {r for asked in self.requests for w in asked.wishes for r in w.pinned}
        if wish is not None:
            free = [r for r in self.robots if r in self.alive and wish.kind in self.able[r]]
            free = [r for r in free if r not in busy and r not in wish.ended]
            if free:
                wish.pinned.append(self._random.choice(free))

    def unpin(self) -> None:
        self._end(success=None)

    def end(self) -> None:
        self._end(success=self._random.random() < 0.7)

    def _end(self, success: bool | None) -> None:
        """A robot stops running something, with an outcome or without."""
        running = [w for asked in self.requests for w in asked.wishes if w.pinned]
        if running:
            wish = self._random.choice(running)
            robot = wish.pinned.pop(self._random.randrange(len(wish.pinned)))
            if success is not None:
                wish.ended.add(robot)
                wish.lower = max(0, wish.lower - success)

    def finish(self) -> None:
        """A request ends; mostly one that a robot works on."""
        served = [a for a in self.requests if any(w.pinned for w in a.wishes)]
        if self.requests:
            self.requests.remove(self._random.choice(served or self.requests))

    def ask(self) -> None:
        place = self._random.randint(0, len(self.requests))
        if len(self.requests) < 1.3 * self.sizes.requests:
            self.requests.insert(place, self._request())

    def lose(self) -> None:
        """A robot can do one thing less, or one more."""
        if self.robots:
            self.able[self._random.choice(self.robots)] ^= {self._random.choice(self.kinds)}

    def exclude(self) -> None:
        if self.requests and self._random.random() < 0.5:
            asked = self._random.choice(self.requests)
            asked.excluded = not asked.excluded

    def narrow(self) -> None:
        """Some robots are no candidates for one demand, as by a schedule, or are again."""
        wish = self._wish()
        if wish is not None:
            half = self._random.sample(self.robots, len(self.robots) // 2)
            wish.narrowed = set(half) if wish.narrowed is None else None
