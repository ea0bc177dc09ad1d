"""Routers between the robots, where there are any: who is linked to which.

A robot is a client of one router at a time. When that dies, its link is gone, and with it all that
is sent to it and by it; a moment later it is linked to the next router that lives.
"""

from __future__ import annotations

import random
from collections.abc import Iterable

# How long a client is without a link when its router has died, as measured; in us.
FAILOVER_US = (3_000, 300_000)
# How often it tries again where no router lives.
RETRY_US = 250_000


class Routers:
    """The routers of one run by name; none: robots have links of their own.

    `of`: robot -> the one that it is linked to.
    """

    def __init__(self, names: Iterable[str], seed: int) -> None:
        self.names = tuple(names)
        self.of: dict[str, str] = {}
        self._dead: set[str] = set()
        self._random = random.Random(f"{seed}/routers")

    def link(self, robot: str) -> bool:
        """Link a robot to a router; False if none lives.

        Real ones take the first that answers. Here it is any, for more varied runs.
        """
        living = [name for name in self.names if name not in self._dead]
        if living:
            self.of[robot] = self._random.choice(living)
        return bool(living)

    def unlink(self, robot: str) -> None:
        """Its process has ended."""
        self.of.pop(robot, None)

    def end(self, router: str) -> dict[str, int]:
        """A router dies: its clients, sorted, and how long each is without a link at least."""
        self._dead.add(router)
        clients = sorted(robot for robot, name in self.of.items() if name == router)
        for robot in clients:
            del self.of[robot]
        return {robot: self._random.randint(*FAILOVER_US) for robot in clients}

    def begin(self, router: str) -> None:
        """A router is there again."""
        self._dead.discard(router)

    def reaches(self, robot: str) -> bool:
        """Whether a robot is linked to a router, or needs none."""
        return not self.names or robot in self.of

    def is_linked(self, robot: str, router: str) -> bool | None:
        """What this router says of its link to a robot; None if it is dead."""
        return None if router in self._dead else self.of.get(robot) == router
