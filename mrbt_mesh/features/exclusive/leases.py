"""Leases: a majority's promise that an exclusive task has one coalition at a time.

A coalition needs a lease of the task from a majority of the robots that the mission names, the
*grantors*. Its members are the *holders*. Leases use heartbeats only: a holder's heartbeat is the
request, first for the lease and then for its renewal; a grantor's heartbeat answers with the number
of the holder's heartbeat.

- Any two majorities share a grantor, and a grantor leases an activation to one coalition at a time,
  so two coalitions never hold it together.
- A lease expires `promise_us` after the last request for it arrived, on the grantor's clock. The
  holder counts a shorter time (`hold_us`), starting when it *sent* that request, so it stops first.
- If the holder's clock stood still, the grantor's did not: once the holder hears the grantor's
  clock, it ages that grantor's confirmations by the difference (`peer_clocks`).
- The first grant is a fact (`grant`), on disk before the answer is sent; a robot whose journal
  cannot be written grants nothing new. Renewals are not written.
- A grantor whose lease expired before all outcomes were known writes that the work may be half done
  (`doubt`).

Source: Gray and Cheriton, Leases: an efficient fault-tolerant mechanism for distributed file cache
consistency, 1989; with a majority in place of the one file server.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

from mrbt_mesh.core.facts.records import LATCH
from mrbt_mesh.core.facts.store import Fact
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.peer_clocks import PeerClocks
from mrbt_mesh.core.membership.replica import Durability
from mrbt_mesh.core.membership.timing import NEVER_US, Timing
from mrbt_mesh.core.membership.wire import Heartbeat, Request, RequestAnswer
from mrbt_mesh.core.mission.mission import majority
from mrbt_mesh.features.exclusive.coalitions import coalitions_of, granted, grantors
from mrbt_mesh.features.exclusive.fields import InDoubtPolicy, in_doubt_policy
from mrbt_mesh.features.exclusive.kinds import DOUBT, GRANT
from mrbt_mesh.features.exclusive.records import CoalitionId

# True if the robot's own view allows giving an activation to a coalition.
MayGrant: TypeAlias = Callable[[str, CoalitionId], bool]


class LeaseHolder:
    """The leases that this robot needs for its own claim, of at most one activation.

    `requested`: what its heartbeats ask for.
    """

    def __init__(self, facts: TeamFacts, timing: Timing, clocks: PeerClocks) -> None:
        self.requested: Request | None = None
        self._facts = facts
        self._timing = timing
        self._clocks = clocks
        # Number of a heartbeat -> when it was sent, for heartbeats that may still be answered.
        self._sent_us: dict[int, int] = {}
        # Grantor -> when the newest request that it answered was sent.
        self._confirmed_us: dict[str, int] = {}

    def request(self, activation: str, coalition: CoalitionId | None) -> None:
        """Request and keep the leases of one coalition; None: request none."""
        wanted = (activation, str(coalition)) if coalition is not None else None
        if wanted != self.requested:
            self.requested = wanted
            self._confirmed_us.clear()

    def resume(self, activation: str, coalition: CoalitionId, now_us: int) -> None:
        """Hold the leases of one coalition, as if all grantors had just renewed them."""
        self.request(activation, coalition)
        self._confirmed_us = dict.fromkeys(grantors(self._facts), now_us)

    def held_until_us(self) -> int:
        """When a majority's leases expire, by this robot's own count; 0: there is no majority."""
        aged_us = self._clocks.aged_us
        confirmed_us = [aged_us(*confirmed) for confirmed in self._confirmed_us.items()]
        newest_us = self._newest_of_majority(confirmed_us)
        return 0 if newest_us is None else newest_us + self._timing.hold_us

    def heard_until_us(self, me: str) -> int:
        """Until when news of a majority counts as recent. After its clock jumped, a grantor counts
        only once it has confirmed a request sent after the jump, as waiting messages may show only
        part of it.
        """
        known_us = []
        for grantor, sent_us in sorted(self._confirmed_us.items()):
            heard_us = self._clocks.heard_us(grantor)
            if heard_us is not None and self._clocks.is_calm(grantor, sent_us):
                known_us.append(heard_us)
        if me in grantors(self._facts):
            known_us.append(NEVER_US)
        newest_us = self._newest_of_majority(known_us)
        return 0 if newest_us is None else newest_us + self._timing.news_us

    def _newest_of_majority(self, times_us: list[int]) -> int | None:
        """Return the latest time that a majority has reached, None if there is no majority."""
        needed = majority(grantors(self._facts))
        return sorted(times_us, reverse=True)[needed - 1] if len(times_us) >= needed else None

    def is_held(self, activation: str, coalition: CoalitionId, now_us: int) -> bool:
        """True if this robot may work on the activation now."""
        return self.requested == (activation, str(coalition)) and now_us < self.held_until_us()

    def note_sent(self, number: int, now_us: int) -> None:
        """Note that a heartbeat is sent, which asks for `requested`."""
        if self.requested is None:
            self._sent_us.clear()
            return
        self._sent_us[number] = now_us
        hold_us = self._timing.hold_us
        for old in [each for each, at_us in self._sent_us.items() if at_us + hold_us < now_us]:
            del self._sent_us[old]

    def confirm(self, grantor: str, grant: RequestAnswer) -> None:
        """Process a grantor's answer to one of this robot's heartbeats."""
        sent_us = self._sent_us.get(grant.number)
        if self.requested is None or grant.party != self.requested[1] or sent_us is None:
            return
        self._confirmed_us[grantor] = max(self._confirmed_us.get(grantor, sent_us), sent_us)


@dataclass(slots=True)
class _Lease:
    """The lease of one activation, as a grantor knows it.

    `answers`: member -> number of its newest heartbeat that renewed the lease. `is_own`: this robot
    granted it; otherwise others did, and this robot only watches when it would have expired.
    `number`: the journal's number of the grant, to know if it is on disk; None until it is written.
    """

    coalition: CoalitionId
    expires_us: int
    is_own: bool
    answers: dict[str, int] = field(default_factory=dict)
    number: int | None = None


class LeaseGrantor:
    """The leases that this robot has granted to coalitions, including its own."""

    def __init__(
        self, me: str, facts: TeamFacts, timing: Timing, now_us: int, durability: Durability
    ) -> None:
        self._me = me
        self._facts = facts
        self._timing = timing
        self._durability = durability
        # By activation.
        self._leases: dict[str, _Lease] = {}
        # A robot that has just started may have granted something in an earlier incarnation.
        self._silent_until_us = now_us + timing.promise_us

    def end_silence(self) -> None:
        """End the initial silence: no robot of the mission knows an earlier life of this one."""
        self._silent_until_us = 0

    @property
    def has_leases(self) -> bool:
        """True if this robot has granted a lease, or watches one."""
        return bool(self._leases)

    def answer_request(
        self, member: str, number: int, request: Request, now_us: int, may_grant: MayGrant
    ) -> list[Fact]:
        """Grant or renew a lease, as heartbeat `number` of a member requests.

        The caller must write the returned facts as a promise and call `written` with its number. No
        answer is sent before it is on disk.
        """
        activation = request[0]
        try:
            coalition = CoalitionId.parse(request[1])
        except ValueError:
            return []
        lease = self._leases.get(activation)
        if lease is not None and lease.coalition != coalition:
            return []
        if lease is not None and lease.is_own:
            self._renew(lease, member, number, now_us)
            return []
        if self._me not in grantors(self._facts) or now_us < self._silent_until_us:
            return []
        if not self._durability.may_promise:
            return []
        if not may_grant(activation, coalition) or not self._is_free(activation, coalition):
            return []
        expires_us = now_us + self._timing.promise_us
        self._leases[activation] = _Lease(coalition, expires_us, True, {member: number})
        return [(f"{GRANT}/{activation}/{coalition}", LATCH)]

    def written(self, number: int) -> None:
        """Note that the grants returned last have been written, under this number."""
        for lease in self._leases.values():
            if lease.is_own and lease.number is None:
                lease.number = number

    def _renew(self, lease: _Lease, member: str, number: int, now_us: int) -> None:
        """Renew a lease unless it has expired: its end is, or is about to become, a fact."""
        if now_us < lease.expires_us:
            lease.answers[member] = max(number, lease.answers.get(member, 0))
            lease.expires_us = now_us + self._timing.promise_us

    def _is_free(self, activation: str, coalition: CoalitionId) -> bool:
        """True if nothing that this robot has granted or doubted conflicts with this coalition.

        A coalition that may have left the work half done excludes every other for good, unless the
        task is to be retried.
        """
        found = coalitions_of(self._facts, activation)
        if coalition in found.broken or coalition in found.doubts:
            return False
        if found.may_begin_again(coalition):
            return False
        task = self._facts.task_of(activation)
        if task is None or in_doubt_policy(task) is InDoubtPolicy.RETRY:
            return True
        own = (other for other in found.grants if self._me in found.grants[other])
        return not any(found.is_open(other) for other in own if other != coalition)

    def grants(self) -> tuple[RequestAnswer, ...]:
        """The answers that this robot's next heartbeat carries."""
        return tuple(
            RequestAnswer(str(lease.coalition), member, lease.answers[member])
            for _, lease in sorted(self._leases.items())
            if lease.number is not None and self._durability.is_on_disk(lease.number)
            for member in sorted(lease.answers)
        )

    def expire(self, now_us: int) -> list[Fact]:
        """Drop leases that have expired or are no longer needed. Returns the facts to write."""
        self._watch_others(now_us)
        writes: list[Fact] = []
        for activation, lease in sorted(self._leases.items()):
            found, coalition = coalitions_of(self._facts, activation), lease.coalition
            never_began = coalition.leader in found.cleared.get(coalition, ())
            # Facts about activations that are out of reach are forgotten, and the lease with them.
            is_forgotten = coalition not in found.grants
            if found.is_resolved(coalition) or never_began or is_forgotten:
                del self._leases[activation]
            elif now_us >= lease.expires_us:
                del self._leases[activation]
                if self._me not in found.doubts.get(coalition, ()):
                    writes.append((f"{DOUBT}/{activation}/{coalition}", LATCH))
        return writes

    def _watch_others(self, now_us: int) -> None:
        """Watch coalitions that others have granted a lease to.

        If they vanish, this robot's doubt counts too. Includes its own grants of an earlier
        incarnation.
        """
        if self._me not in grantors(self._facts):
            return
        for activation, found in granted(self._facts):
            if activation in self._leases:
                continue
            for coalition in sorted(found.grants):
                if found.is_open(coalition) and self._me not in found.doubts.get(coalition, ()):
                    is_own = self._me in found.grants[coalition]
                    expires_us = now_us + self._timing.promise_us
                    self._leases[activation] = _Lease(coalition, expires_us, is_own, number=0)
                    break

    def next_expiry_us(self) -> int | None:
        """When the next lease expires."""
        return min((lease.expires_us for lease in self._leases.values()), default=None)


class Leases:
    """One robot's leases as a holder and as a grantor, and the heartbeats that carry them."""

    def __init__(
        self,
        me: str,
        facts: TeamFacts,
        timing: Timing,
        now_us: int,
        durability: Durability,
        clocks: PeerClocks,
    ) -> None:
        self._me = me
        self._facts = facts
        self.holder = LeaseHolder(facts, timing, clocks)
        self.grantor = LeaseGrantor(me, facts, timing, now_us, durability)

    def heartbeat_sent(self, number: int, now_us: int, may_grant: MayGrant) -> list[Fact]:
        """Process this robot's own heartbeat, a request that this robot answers itself first."""
        holder, grantor = self.holder, self.grantor
        holder.note_sent(number, now_us)
        if holder.requested is None:
            return []
        writes = grantor.answer_request(self._me, number, holder.requested, now_us, may_grant)
        self.take_own_answers()
        return writes

    def take_own_answers(self) -> None:
        """Confirm what this robot has granted to itself, as far as it is on disk."""
        self._confirm(self._me, self.grantor.grants())

    def receive_heartbeat(
        self, robot: str, heartbeat: Heartbeat, now_us: int, may_grant: MayGrant
    ) -> list[Fact]:
        """Process another robot's heartbeat: its answers to this robot, and its own request."""
        if robot in grantors(self._facts):
            self._confirm(robot, heartbeat.answers)
        request, report = heartbeat.request, heartbeat.report
        if request is None or not report.has_joined:
            return []
        return self.grantor.answer_request(robot, report.number, request, now_us, may_grant)

    def _confirm(self, grantor: str, grants: tuple[RequestAnswer, ...]) -> None:
        for grant in grants:
            if grant.robot == self._me:
                self.holder.confirm(grantor, grant)

    @property
    def is_idle(self) -> bool:
        """True if this robot neither needs leases nor has granted or watches any."""
        return self.holder.requested is None and not self.grantor.has_leases

    def next_deadline_us(self) -> int | None:
        """When the next lease expires, granted or held."""
        expires_us, held_until_us = self.grantor.next_expiry_us(), 0
        if self.holder.requested is not None:
            held_until_us = self.holder.held_until_us()
        return min((each for each in (expires_us, held_until_us) if each), default=None)
