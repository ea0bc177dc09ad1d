"""The rounds of a mission that never ends: each time that T_G is Running, from begin to end."""

from __future__ import annotations

from dataclasses import dataclass, field

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.observer.newest import Newest


@dataclass(slots=True)
class MissionRound:
    """One time that T_G was Running: its result (None: not yet), and the robots that took part."""

    from_us: int
    to_us: int | None = None
    result: Status | None = None
    robots: set[str] = field(default_factory=set)


class MissionRounds:
    """The rounds, in order."""

    def __init__(self, limit: int | None = None) -> None:
        self.all = Newest[MissionRound](limit)
        # The last result of T_G, in a round or before the first one.
        self._standing: Status | None = None
        # Robots that have begun something since the last round, before a new one was noticed.
        self._early: set[str] = set()

    @property
    def current(self) -> MissionRound | None:
        """The round that is on its way."""
        return self.all[-1] if self.all and self.all[-1].result is None else None

    @property
    def result(self) -> Status | None:
        """The result of the last round that has ended, or that of T_G if there was no round."""
        has_only_begun = self.all.total == 1 and self.current is not None
        return None if has_only_begun else self._standing

    def running(self, now_us: int) -> bool:
        """T_G is Running: whether a round has just begun."""
        if self.current is not None:
            return False
        self.all.append(MissionRound(now_us, robots=self._early))
        self._early = set()
        return True

    def took_part(self, robot: str) -> None:
        """The robot has begun something."""
        robots = self._early if self.current is None else self.current.robots
        robots.add(robot)

    def ended(self, result: Status, now_us: int) -> MissionRound | None:
        """T_G has this result: the round that has just ended with it.

        A result that becomes another one without work in between is a round of its own. A team
        that has stood by from the beginning has had none.
        """
        ended = self.current
        if ended is None:
            if self._standing in (None, result):
                self._standing = result
                return None
            ended = MissionRound(now_us)
            self.all.append(ended)
        ended.to_us, ended.result = now_us, result
        self._standing = result
        return ended
