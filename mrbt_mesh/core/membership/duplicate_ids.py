"""One robot per id: what a process does when another one runs under its own id.

A newcomer refuses to start beside a live robot with its id (or replaces it, on request). A process
that hears of a higher incarnation of its id that it did not take stops; it never outbids it.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.facts.team_facts import KnownMember
from mrbt_mesh.core.membership.signed_reports import SignedReports
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, Suspicion


class DuplicateIdCheck:
    """Watches one process's own id. Its checks return why to stop, or None.

    `other_incarnation`: the highest incarnation of this id that is not this process's own; it sends
    heartbeats, or others suspect it. `changes` grows with each new one. What others report of it
    counts only if the report was signed under this id.
    """

    def __init__(
        self, me: str, nonce: str, takeover: bool, timing: Timing, reports: SignedReports
    ) -> None:
        self.other_incarnation = Incarnation(0, "")
        self.changes = 0
        self._me = me
        self._nonce = nonce
        self._takeover = takeover
        self._reports = reports
        # How long heartbeats of an ended incarnation may still be relayed.
        self._settling_us = 3 * timing.heartbeat_us
        # When another incarnation was first relayed, its highest heartbeat number, and by which
        # robots.
        self._relayed_since_us: int | None = None
        self._relayed_number = 0
        self._relayed_by: set[str] = set()

    def restart(self) -> None:
        """Forget which robots relay another incarnation, because joining starts anew."""
        self._relayed_since_us, self._relayed_number = None, 0
        self._relayed_by.clear()

    @property
    def is_other_life_relayed(self) -> bool:
        """True if others still relay another incarnation of this id as alive.

        An incarnation that is being replaced on purpose is not waited for.
        """
        return bool(self._relayed_by) and not self._takeover

    def check_own_heartbeat(
        self,
        heartbeat: Heartbeat,
        mine: Incarnation,
        is_starting: bool,
        members: Mapping[str, KnownMember],
    ) -> str | None:
        """Check a heartbeat that arrived under this robot's own id."""
        incarnation, has_joined = heartbeat.report.incarnation, heartbeat.report.has_joined
        if incarnation.nonce == self._nonce or heartbeat.is_leaving:
            return None
        if not is_starting:
            return self._replaced_by(incarnation, mine) if has_joined else None
        self._note(incarnation)
        may_replace = self._takeover and mine.counter == 0
        if not may_replace and (has_joined or incarnation > mine):
            return self._is_running(members)
        return None

    def check_relays(
        self,
        source: str,
        heartbeat: Heartbeat,
        mine: Incarnation,
        is_starting: bool,
        members: Mapping[str, KnownMember],
        now_us: int,
    ) -> str | None:
        """Check a heartbeat of another robot, which may relay a report under this id.

        While this process starts, heartbeats of an earlier incarnation may still be on their way.
        If their number grows after all of them must have arrived, another process runs under this
        id.
        """
        for suspicion in heartbeat.suspicions:
            is_mine = suspicion.robot == self._me
            if is_mine and suspicion.incarnation.nonce != self._nonce:
                self._note_suspected(suspicion)
        relayed = heartbeat.relays.get(self._me)
        if relayed is None or relayed.incarnation.nonce == self._nonce:
            self._relayed_by.discard(source)
            return None
        is_later = relayed.has_joined and relayed.incarnation > mine
        if (not is_starting and not is_later) or not self._reports.is_authentic(self._me, relayed):
            return None
        if not is_starting:
            return self._replaced_by(relayed.incarnation, mine)
        self._relayed_by.add(source)
        if self._relayed_since_us is None:
            self._relayed_since_us = now_us
        has_grown = relayed.number > self._relayed_number
        self._relayed_number = max(self._relayed_number, relayed.number)
        is_settled = now_us >= self._relayed_since_us + self._settling_us
        if has_grown and is_settled and not self._takeover:
            return self._is_running(members)
        return None

    def _note_suspected(self, suspicion: Suspicion) -> None:
        other, report = suspicion.incarnation, suspicion.report
        if other > self.other_incarnation and (
            self._reports.is_authentic(self._me, report)
            if report is not None
            else self._reports.needs_no_signature
        ):
            self._note(other)

    def _note(self, other: Incarnation) -> None:
        if other > self.other_incarnation:
            self.other_incarnation = other
            self.changes += 1

    def _is_running(self, members: Mapping[str, KnownMember]) -> str:
        known = members.get(self._me)
        where = f" (pid {known.member.pid} on {known.member.host})" if known else ""
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
