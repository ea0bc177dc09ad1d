"""Tracks which sessions hold the liveliness token of each robot's life: the robot, perhaps
strangers.

Any session on the network may declare a token in a robot's name and withdraw it again, as often as
it likes, but it cannot withdraw another session's. So a token has disappeared once no session holds
it: a stranger can only keep one up. A robot that has moved to another router, or reopened its
session, declares a new token before the old one ends.

Tokens are hints, so a bounded amount of work and memory is spent on them: on robots that may exist,
a few lives of each, and a number of changes per second for each robot. Once a change of a robot was
skipped, the holders of its token are no longer known, and the end of its token is not reported,
until all tokens have been listed again after a quiet time (`must_list_again`). Heartbeats decide
meanwhile.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.keys import Keys, Role
from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.flood_gate import Budget

# Per robot: changes at once after a pause, and per second; lives, and sessions of each.
CHANGES_AT_ONCE, CHANGES_PER_S = 20, 5
MAX_LIVES, MAX_HOLDERS = 8, 8
MAX_ROBOTS = 1_000
# The name under which observers declare their tokens.
OBSERVER = "observer"
# How long no change was skipped before all tokens are listed again.
QUIET_US = 30_000_000
# The life of a robot not heard yet: older than any.
UNHEARD = Incarnation(0, "")

# Returns the life in which a robot is known; None: there is no robot of that name.
LifeOf = Callable[[str], Incarnation | None]


def life_of(peers: Callable[[], Mapping[str, Peer]], keys: Keys | None) -> LifeOf:
    """Return a function that tells the life in which a robot is known.

    Peers are known; other robots may exist if they have keys, or if the team has none.
    """

    def find(robot: str) -> Incarnation | None:
        peer = peers().get(robot)
        if peer is not None:
            return peer.incarnation
        is_robot = robot != OBSERVER if keys is None else keys.role_of(robot) is Role.ROBOT
        return UNHEARD if is_robot else None

    return find


class Holder(NamedTuple):
    """The ids of a Zenoh session and of the router that it names; no router for a peer."""

    session: str
    router: str


class Change(enum.Enum):
    """The meaning of a change.

    The token of the robot's present life is held (perhaps by one more session), or has disappeared;
    or the change means nothing; or it was skipped, because there are too many, or no such robot.
    """

    HELD = enum.auto()
    GONE = enum.auto()
    NOTHING = enum.auto()
    PASSED_OVER = enum.auto()


@dataclass(slots=True)
class _Life:
    """The holders of a life's token in order of appearance, and the last session that held it."""

    holders: dict[Holder, None] = field(default_factory=dict)
    last_session: str = ""


@dataclass(slots=True)
class _Robot:
    """What is known about a robot.

    `is_doubtful`: a change was skipped, so its holders are unknown.
    """

    budget: Budget
    lives: dict[Incarnation, _Life] = field(default_factory=dict)
    is_doubtful: bool = False


class TokenHolders:
    """The holders of the token of each life of each robot, as far as heard. Not thread-safe.

    `clock` is in us.
    """

    def __init__(self, life_of: LifeOf, clock: Callable[[], int] = boottime_us) -> None:
        self._life_of = life_of
        self._clock = clock
        self._robots: dict[str, _Robot] = {}
        self._others = _budget(clock())
        self._passed_over_us: int | None = None

    def change(self, robot: str, incarnation: Incarnation, holder: Holder, held: bool) -> Change:
        """Process that a session holds the token or no longer does; return what it means."""
        now_us, present = self._clock(), self._life_of(robot)
        known = self._robots.get(robot)
        if known is None:
            if present is None or len(self._robots) >= MAX_ROBOTS:
                return self._pass_over_other(robot, now_us)
            known = self._robots[robot] = _Robot(_budget(now_us))
        life = known.lives.get(incarnation)
        if life is not None and not held and holder in life.holders:
            del life.holders[holder]
            life.last_session = holder.session
            is_gone = not life.holders and incarnation == present and not known.is_doubtful
            return Change.GONE if is_gone else Change.NOTHING
        is_old = present is not None and incarnation < present
        if known.budget.takes(now_us):
            if is_old or not held or (life is not None and holder in life.holders):
                return Change.NOTHING
            life = _place(known.lives, incarnation, present)
            if life is not None:
                is_first = not life.holders
                life.holders[holder], life.last_session = None, holder.session
                is_news = incarnation == present and (is_first or bool(holder.router))
                return Change.HELD if is_news else Change.NOTHING
        if held and not is_old:
            known.is_doubtful, self._passed_over_us = True, now_us
        return Change.PASSED_OVER

    def _pass_over_other(self, name: str, now_us: int) -> Change:
        """Skip a token of an observer, of a new robot whose key is not known here yet, or of a
        stranger.
        """
        if name != OBSERVER:
            self._passed_over_us = now_us
        return Change.NOTHING if self._others.takes(now_us) else Change.PASSED_OVER

    def knows(self, robot: str) -> bool:
        """Return whether the robot may exist and has declared a token."""
        return robot in self._robots

    def must_list_again(self) -> bool:
        """Return whether a change was skipped, but none for a while: `clear`, and list the tokens
        again.
        """
        at_us = self._passed_over_us
        return at_us is not None and self._clock() - at_us >= QUIET_US

    def last_session(self, robot: str, incarnation: Incarnation) -> str:
        """Return the session that last declared or held the token of this life.

        Empty if unknown.
        """
        known = self._robots.get(robot)
        life = known.lives.get(incarnation) if known is not None else None
        return life.last_session if life is not None else ""

    def robots_of(self, sessions: set[str]) -> frozenset[str]:
        """Return the robots whose token one of these sessions holds."""
        return frozenset(
            robot
            for robot, known in self._robots.items()
            for life in known.lives.values()
            if any(holder.session in sessions for holder in life.holders)
        )

    def clear(self) -> None:
        """Forget everything, because all tokens are about to be listed again."""
        self._robots.clear()
        self._passed_over_us = None


def _budget(now_us: int) -> Budget:
    return Budget(CHANGES_AT_ONCE, CHANGES_PER_S, now_us)


def _place(
    lives: dict[Incarnation, _Life], incarnation: Incarnation, present: Incarnation | None
) -> _Life | None:
    """Return the entry for one more holder of a token; None: there are too many."""
    life = lives.get(incarnation)
    if life is None:
        for each in [i for i, life in lives.items() if not life.holders and i != present]:
            del lives[each]
        if len(lives) < MAX_LIVES:
            life = lives[incarnation] = _Life()
    return life if life is not None and len(life.holders) < MAX_HOLDERS else None
