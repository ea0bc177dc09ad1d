"""One robot per id: what a process does when another one lives under its own id.

A newcomer refuses to start beside a live robot of its id (or replaces it, on request). A
process that hears of a higher incarnation of its id that it did not take stops; it never
outbids it.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat


class DuplicateIdCheck:
    """Watches one process's own id. Methods return why to stop, or None.

    `rival` is the highest incarnation under this id that is not this process's own: of one that
    beats, or that others bury. `rivals` grows with each new one.
    """

    def __init__(self, me: str, nonce: str, takeover: bool, timing: Timing) -> None:
        self._me = me
        self._nonce = nonce
        self._takeover = takeover
        self._patience_us = 3 * timing.heartbeat_us
        self._relayed_us: int | None = None
        self._relayed_number = 0
        self._relayed_by: set[str] = set()
        self.other_incarnation = Incarnation(0, "")
        self.changes = 0

    def restart(self) -> None:
        """Begin to start anew: forget who counts this id among the living."""
        self._relayed_us, self._relayed_number = None, 0
        self._relayed_by.clear()

    @property
    def is_other_life_relayed(self) -> bool:
        """Whether others still count another life of this id among the living.

        One that is being replaced on purpose is not waited for.
        """
        return bool(self._relayed_by) and not self._takeover

    def check_own_heartbeat(
        self,
        heartbeat: Heartbeat,
        mine: Incarnation,
        is_starting: bool,
        members: Mapping[str, _Known],
    ) -> str | None:
        """A beat arrived under this robot's own id."""
        incarnation, joined = heartbeat.report.incarnation, heartbeat.report.has_joined
        if incarnation.nonce == self._nonce or heartbeat.is_leaving:
            return None
        if not is_starting:
            return self._replaced_by(incarnation, mine) if joined else None
        self._notice(incarnation)
        may_replace = self._takeover and mine.counter == 0
        if not may_replace and (joined or incarnation > mine):
            return self._is_running(members)
        return None

    def check_relays(
        self,
        source: str,
        heartbeat: Heartbeat,
        mine: Incarnation,
        is_starting: bool,
        members: Mapping[str, _Known],
        now_us: int,
    ) -> str | None:
        """A beat of another robot arrived, which may relay one of this id.

        While starting, an earlier life's beats may still be on their way. If they grow in
        number after all of those must have arrived, somebody lives under this id.
        """
        for accusation in heartbeat.suspicions:
            if accusation.robot == self._me and accusation.incarnation.nonce != self._nonce:
                self._notice(accusation.incarnation)
        relay = heartbeat.relays.get(self._me)
        if relay is None or relay.incarnation.nonce == self._nonce:
            self._relayed_by.discard(source)
            return None
        if not is_starting:
            return self._replaced_by(relay.incarnation, mine) if relay.has_joined else None
        self._relayed_by.add(source)
        if self._relayed_us is None:
            self._relayed_us = now_us
        grown = relay.number > self._relayed_number
        self._relayed_number = max(self._relayed_number, relay.number)
        if grown and now_us >= self._relayed_us + self._patience_us and not self._takeover:
            return self._is_running(members)
        return None

    def _notice(self, other: Incarnation) -> None:
        if other > self.other_incarnation:
            self.other_incarnation = other
            self.changes += 1

    def _is_running(self, members: Mapping[str, _Known]) -> str:
        known = members.get(self._me)
        where = f" (pid {known[0].pid} on {known[0].host})" if known else ""
        return (
            f"robot {self._me} is already running{where}: choose another id, stop it first, "
            "or start with --takeover to replace it"
        )

    def _replaced_by(self, other: Incarnation, mine: Incarnation) -> str | None:
        if other <= mine:
            return None
        return (
            f"another process has taken over the id {self._me} "
            f"(incarnation {other}, ours was {mine})"
        )


_Known = tuple[Member, Incarnation]
