"""Who holds the liveliness token of a robot's life: the robot itself, and perhaps somebody else.

Anybody may show a token in a robot's name and take it down again. Zenoh tells of each session's
token apart, and nobody can take down another one's. So a token is gone once nobody holds it any
more; a stranger can keep one up, and no more than that. A robot that has found another router, or
opened its session anew, shows a new token before the old one ends.
"""

from __future__ import annotations

from typing import NamedTuple

from mrbt_mesh.core.facts.store import Incarnation

# Beyond so many, what further sessions hold is not looked at.
MAX_HOLDERS, MAX_LIVES = 8, 10_000


class Holder(NamedTuple):
    """The ids of a Zenoh session and of the router that it names; that is empty for a peer."""

    session: str
    router: str


class TokenHolders:
    """Who holds the token of each life of each robot, as far as is heard. Not thread-safe."""

    def __init__(self) -> None:
        # In order of appearance.
        self._holders: dict[tuple[str, Incarnation], dict[Holder, None]] = {}
        self._last_session: dict[tuple[str, Incarnation], str] = {}

    def change(
        self, robot: str, incarnation: Incarnation, holder: Holder, held: bool
    ) -> bool | None:
        """One session holds the token or does so no more.

        Returns True if that is new, False if the token is gone; None: neither.
        """
        life = robot, incarnation
        holders = self._holders.get(life, {})
        if held:
            is_full = len(holders) >= MAX_HOLDERS if holders else len(self._holders) >= MAX_LIVES
            if holder in holders or is_full:
                return None
            self._holders.setdefault(life, {})[holder] = None
            self._note_last(life, holder)
            return True
        if holder not in holders:
            return None
        del holders[holder]
        if holders:
            return None
        del self._holders[life]
        self._note_last(life, holder)
        return False

    def _note_last(self, life: tuple[str, Incarnation], holder: Holder) -> None:
        self._last_session[life] = holder.session
        if len(self._last_session) > MAX_LIVES:
            del self._last_session[next(iter(self._last_session))]

    def last_session(self, robot: str, incarnation: Incarnation) -> str:
        """The session that showed the token of this life last, or held it to the end; or empty."""
        return self._last_session.get((robot, incarnation), "")

    def robots_of(self, sessions: set[str]) -> frozenset[str]:
        """The robots whose token one of these sessions holds."""
        return frozenset(
            robot
            for (robot, _), holders in self._holders.items()
            if any(holder.session in sessions for holder in holders)
        )

    def clear(self) -> None:
        """The session that heard all this is no more."""
        self._holders.clear()
        self._last_session.clear()
