"""Watches the links of one robot: which fall silent, recover, or are split.

A link is *split* when its transport looks alive and nothing arrives over it. Zenoh can stay like
that for good (see `zenoh_transport`), and only a new session repairs it. A process that hangs looks
the same from here, but then no robot has news of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sighting:
    """One robot as seen now. Times are on one clock; None: never.

    `heard_us`: its last beat over its own link; `news_us`: the last news of it by any way.
    """

    heard_us: int | None
    news_us: int
    linked: bool


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """A change of a link.

    `what` is `link_up` (heard for the first time), `link_silent`, `link_heard` (again), or
    `link_unwatched` (silent, of a robot that is no longer a neighbour).
    """

    what: str
    robot: str
    silent_us: int


@dataclass(slots=True)
class _Link:
    heard_us: int | None
    is_silent: bool = False
    # Since when there has been a transport over which nothing came.
    mute_us: int | None = None


class LinkWatch:
    """Detects changes of links. Call `look` regularly, then `split`.

    After `lease_us` of silence a link is reported as silent; the lease must be long enough for a
    dead link to have lost its transport. After two leases with a transport and without a beat, it
    is split if other robots have news of the robot; after five or more if none has. Each further
    reopening must wait twice as long, until no link is split.
    """

    def __init__(self, lease_us: int) -> None:
        self._lease_us = lease_us
        self._links: dict[str, _Link] = {}
        self._patience_us = 2 * lease_us
        self._not_before_us = 0

    def look(self, robots: Mapping[str, Sighting], now_us: int) -> list[LinkEvent]:
        """Update the links; return what has changed."""
        events = []
        for gone in [robot for robot in self._links if robot not in robots]:
            link = self._links.pop(gone)
            if link.is_silent:
                silent_us = now_us - (now_us if link.heard_us is None else link.heard_us)
                events.append(LinkEvent("link_unwatched", gone, silent_us))
        for robot, sighting in robots.items():
            event = self._look_at(robot, sighting, now_us)
            if event is not None:
                events.append(event)
        return events

    def _look_at(self, robot: str, sighting: Sighting, now_us: int) -> LinkEvent | None:
        link = self._links.setdefault(robot, _Link(None))
        before_us, link.heard_us = link.heard_us, sighting.heard_us
        if not sighting.linked or link.heard_us != before_us:
            link.mute_us = None
        elif link.mute_us is None:
            link.mute_us = now_us
        if link.heard_us is None:
            return None
        if before_us is None:
            return LinkEvent("link_up", robot, 0)
        if link.is_silent and link.heard_us != before_us:
            link.is_silent = False
            return LinkEvent("link_heard", robot, link.heard_us - before_us)
        if not link.is_silent and now_us - link.heard_us >= self._lease_us:
            link.is_silent = True
            return LinkEvent("link_silent", robot, now_us - link.heard_us)
        return None

    def split(self, robots: Mapping[str, Sighting], rank: int, now_us: int) -> str | None:
        """Return a robot from which this one is split, if the session must be reopened now.

        `rank` is this robot's position among all, so that not all reopen at once.
        """
        mute = {
            robot: now_us - link.mute_us
            for robot, link in sorted(self._links.items())
            if link.mute_us is not None
        }
        if now_us < self._not_before_us:
            return None
        if all(mute_us < self._lease_us // 2 for mute_us in mute.values()):
            self._patience_us = 2 * self._lease_us
        alone_us = 5 * self._lease_us + rank * self._lease_us // 2
        for robot, mute_us in mute.items():
            is_heard = now_us - robots[robot].news_us < self._lease_us // 2
            if mute_us >= (2 * self._lease_us if is_heard else alone_us):
                return robot
        return None

    def reopened(self, now_us: int) -> None:
        """Reset all links, because the session is a new one."""
        for link in self._links.values():
            link.mute_us = None
        self._not_before_us = now_us + self._patience_us
        self._patience_us *= 2
