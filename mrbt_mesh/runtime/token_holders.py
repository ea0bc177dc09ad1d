"""Who holds the liveliness token of a robot's life: the robot itself, and perhaps somebody else.

Anybody may show a token in a robot's name and take it down again. Zenoh tells of each session's
token apart, and nobody can take down another one's. So a token is gone once nobody holds it any
more; a stranger can keep one up, and no more than that.
"""

from __future__ import annotations

from mrbt_mesh.core.facts.store import Incarnation

# Beyond so many, what further sessions hold is not looked at.
MAX_HOLDERS, MAX_LIVES = 8, 10_000


class TokenHolders:
    """The sessions that hold the token of each life of each robot, as far as is heard."""

    def __init__(self) -> None:
        self._sessions: dict[tuple[str, Incarnation], set[str]] = {}

    def change(self, robot: str, incarnation: Incarnation, session: str, held: bool) -> bool | None:
        """One session holds the token or does so no more.

        Returns True if the token is new, False if it is gone; None: neither.
        """
        life = robot, incarnation
        holders = self._sessions.get(life)
        if held:
            if holders is None:
                if len(self._sessions) >= MAX_LIVES:
                    return None
                self._sessions[life] = {session}
                return True
            if len(holders) < MAX_HOLDERS:
                holders.add(session)
            return None
        if holders is None or session not in holders:
            return None
        holders.discard(session)
        if holders:
            return None
        del self._sessions[life]
        return False

    def clear(self) -> None:
        """The session that heard all this is no more."""
        self._sessions.clear()
