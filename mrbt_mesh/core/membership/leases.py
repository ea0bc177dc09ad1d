"""Grants: the promise of a majority that an exclusive task has one coalition at a time.

Whoever seeks or holds a task says so in every beat, and whoever grants it answers with the
number of that beat. A grant runs out one lease after the last beat that renewed it, on the
giver's clock; the holder counts a shorter time from when it *sent* that beat, so it stops
first. Any two majorities share a giver, and a giver grants an activation to one coalition at a
time, so two coalitions never hold it together. Source: leases (Gray and Cheriton, 1989), with
the majority of Paxos in place of the file server.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.coalitions import majority
from mrbt_mesh.core.facts.records import CoalitionId
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, LeaseGrant
from mrbt_mesh.core.mission.mission import InDoubtPolicy

_Writes: TypeAlias = list[tuple[str, Any]]


@dataclass(slots=True)
class _Given:
    """A coalition that this robot lets have an activation until `expires_us`.

    `echoes`: member -> number of its newest beat that renewed it. Without `granted` it is only
    known from others' grants: this robot says when it would have run out.
    """

    token: CoalitionId
    expires_us: int
    granted: bool
    echoes: dict[str, int] = field(default_factory=dict)


class Leases:
    """What one robot grants to others, and what it holds itself."""

    def __init__(self, me: str, facts: TeamFacts, timing: Timing, now_us: int) -> None:
        self._me = me
        self._facts = facts
        self._timing = timing
        self._given: dict[str, _Given] = {}
        self._sent_us: dict[int, int] = {}
        self._confirmed_us: dict[str, int] = {}
        # A robot that has just started may have granted something in an earlier life.
        self._silent_until_us = now_us + timing.lease_us
        self.seeks: tuple[str, str] | None = None

    def end_silence(self) -> None:
        """All robots of the mission were asked, and none knows of an earlier life of this one."""
        self._silent_until_us = 0

    # -- the holder ---------------------------------------------------------------------------

    def seek(self, activation: str, token: CoalitionId | None) -> None:
        """Ask for, or keep, the grants of one coalition; None: of none."""
        wanted = (activation, str(token)) if token is not None else None
        if wanted != self.seeks:
            self.seeks = wanted
            self._confirmed_us.clear()

    def held_until_us(self) -> int:
        """Until when a majority's grants last, by this robot's own count; 0: there is none."""
        needed = majority(self._facts.grantors)
        newest = sorted(self._confirmed_us.values(), reverse=True)
        if len(newest) < needed:
            return 0
        return newest[needed - 1] + self._timing.hold_us

    def holds(self, activation: str, token: CoalitionId, now_us: int) -> bool:
        """Whether this robot may work on the activation now."""
        return self.seeks == (activation, str(token)) and now_us < self.held_until_us()

    def sent(
        self, number: int, now_us: int, may_grant: Callable[[str, CoalitionId], bool]
    ) -> _Writes:
        """This robot's beat goes out: it is a request, and this robot answers itself first."""
        if self.seeks is None:
            self._sent_us.clear()
            return []
        self._sent_us[number] = now_us
        for old in [
            n for n, at_us in self._sent_us.items() if at_us + self._timing.hold_us < now_us
        ]:
            del self._sent_us[old]
        writes = self._asked(self._me, number, self.seeks, now_us, may_grant)
        self._confirm(self._me, [g for g in self.given() if g.member == self._me])
        return writes

    def _confirm(self, giver: str, granted: list[LeaseGrant]) -> None:
        for grant in granted:
            sent_us = self._sent_us.get(grant.number)
            if self.seeks is not None and grant.token == self.seeks[1] and sent_us is not None:
                before_us = self._confirmed_us.get(giver, sent_us)
                self._confirmed_us[giver] = max(before_us, sent_us)

    # -- the giver ----------------------------------------------------------------------------

    def heard(
        self,
        robot: str,
        beat: Heartbeat,
        now_us: int,
        may_grant: Callable[[str, CoalitionId], bool],
    ) -> _Writes:
        """A beat of another robot: its request, and its answers to this robot's requests."""
        if robot in self._facts.grantors:
            self._confirm(robot, [grant for grant in beat.lease_grants if grant.member == self._me])
        if beat.lease_request is None or not beat.report.has_joined:
            return []
        return self._asked(robot, beat.report.number, beat.lease_request, now_us, may_grant)

    def _asked(
        self,
        member: str,
        number: int,
        sought: tuple[str, str],
        now_us: int,
        may_grant: Callable[[str, CoalitionId], bool],
    ) -> _Writes:
        """Renew or give a grant; what is written must be on disk before the answer goes out."""
        activation = sought[0]
        try:
            token = CoalitionId.parse(sought[1])
        except ValueError:
            return []
        given = self._given.get(activation)
        if given is not None and given.granted and given.token == token:
            if now_us < given.expires_us:
                given.echoes[member] = max(number, given.echoes.get(member, 0))
                given.expires_us = now_us + self._timing.lease_us
            return []
        if given is not None and given.token != token:
            return []
        if self._me not in self._facts.grantors or now_us < self._silent_until_us:
            return []
        if not may_grant(activation, token) or not self._is_free(activation, token):
            return []
        expires_us = now_us + self._timing.lease_us
        self._given[activation] = _Given(token, expires_us, True, {member: number})
        return [(f"{records.GRANT}/{activation}/{token}", True)]

    def _is_free(self, activation: str, token: CoalitionId) -> bool:
        """Whether nothing that this robot has granted or doubted speaks against it.

        A coalition that may have left the work half done excludes every other for good, unless
        the task is to be tried again.
        """
        found = self._facts.coalitions(activation)
        if token in found.broken or token in found.doubts or token in found.cleared:
            return False
        task = self._facts.task_of(activation)
        if task is None or task.in_doubt is InDoubtPolicy.RETRY:
            return True
        mine = (other for other in found.grants if self._me in found.grants[other])
        return not any(found.is_open(other) for other in mine if other != token)

    def given(self) -> tuple[LeaseGrant, ...]:
        """The answers that this robot's next beat carries."""
        if not self._given:
            return ()
        return tuple(
            LeaseGrant(str(given.token), member, given.echoes[member])
            for _, given in sorted(self._given.items())
            for member in sorted(given.echoes)
        )

    def step(self, now_us: int) -> _Writes:
        """Follow the facts and the clock; returns what to write of grants that have run out."""
        self._learn(now_us)
        writes: _Writes = []
        if not self._given:
            return writes
        for activation, given in sorted(self._given.items()):
            found = self._facts.coalitions(activation)
            never_began = given.token.leader in found.cleared.get(given.token, ())
            if found.is_resolved(given.token) or never_began or not self._knows(activation, given):
                del self._given[activation]
            elif now_us >= given.expires_us:
                del self._given[activation]
                if self._me in found.doubts.get(given.token, ()):
                    continue
                writes.append((f"{records.DOUBT}/{activation}/{given.token}", True))
        return writes

    def _knows(self, activation: str, given: _Given) -> bool:
        """Whether the facts still speak of this grant; what is out of reach is forgotten."""
        return given.token in self._facts.coalitions(activation).grants

    def _learn(self, now_us: int) -> None:
        """Watch over coalitions to which somebody has granted something.

        If they vanish, this robot's word counts too. Its own grants of an earlier life are
        among them.
        """
        for activation, found in self._facts.granted():
            if activation in self._given or self._me not in self._facts.grantors:
                continue
            for token in sorted(found.grants):
                if found.is_open(token) and self._me not in found.doubts.get(token, ()):
                    mine = self._me in found.grants[token]
                    expires_us = now_us + self._timing.lease_us
                    self._given[activation] = _Given(token, expires_us, mine)
                    break

    @property
    def is_idle(self) -> bool:
        """Whether this robot neither seeks grants nor has given any."""
        return self.seeks is None and not self._given

    def next_deadline_us(self) -> int | None:
        """When the next grant runs out, given or held."""
        deadlines = [given.expires_us for given in self._given.values()]
        if self.seeks is not None and self.held_until_us():
            deadlines.append(self.held_until_us())
        return min(deadlines, default=None)
