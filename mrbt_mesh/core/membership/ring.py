"""Large teams: robots hear their neighbours in a ring, so a robot's traffic does not grow with its
team.

A robot's neighbours are the `reach` healthy robots on either side of it, ordered by a hash of their
ids: so robots that fail together, because they are alike or near one another, are seldom
neighbours. Neighbours hear one another's heartbeats, judge one another's silence and relay news of
one another. A robot's heartbeats also go to:

- one more robot with each heartbeat, taking turns among the whole team, dead robots included: so
  two parts of a team that were cut off from each other find out, and differences are repaired;
- robots that judge this robot or are new, by their own last heartbeat: so two robots that see
  different rings hear each other;
- while this robot is about to join, some robots that it has not heard yet;
- robots that are *checked*, because others disagree with this robot about whether they are alive;
- everybody, if the heartbeat concerns everybody: a robot leaves, requests something, has declared
  a neighbour dead, or is alive although others have declared it dead;
- robots that wait for agreement, through representatives. The ring of the mission's robots is cut
  into *groups*; there are about as many groups as robots in each. The first healthy robots of a
  group *represent* it: the others report each new plan to them, and once the whole group has the
  same plan they relay its self-reports to the robots that wait. These then receive two messages
  per group instead of one per robot. What counts is still what each robot has reported itself.

Sources: consistent hashing (Karger et al. 1997); neighbours as monitors: Chord (Stoica et al.
2001); Lifeguard's local health (Dadgar, Phillips, Currey 2018).
"""

from __future__ import annotations

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import lru_cache
from math import isqrt

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.dissemination import (
    Dissemination,
    Judges,
    Route,
    Urgent,
    Waiting,
)
from mrbt_mesh.core.membership.peer import Peer, State, set_member
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import DIGEST_BYTES, Heartbeat, SelfReport

# The most robots that are checked at a time, sought per heartbeat by a newcomer, and named as
# suspects in a heartbeat.
MAX_CHECKED, SOUGHT_AT_A_TIME, MAX_SUSPICIONS = 16, 4, 32
# Representatives per group. The second one covers for a lost message. One that dies is itself a
# robot whose report is awaited until it is declared dead.
REPRESENTATIVES = 2
# Plans are spaced by at least this much per other robot.
PLAN_SPACING_US = 200
# The most detection times by which a robot in trouble waits longer for silent robots.
MAX_EXTRA_DETECTIONS = 4


@lru_cache(maxsize=4_096)
def place(robot: str) -> bytes:
    """A robot's place in the ring: 8 bytes."""
    return hashlib.blake2b(robot.encode(), digest_size=8).digest()


class Ring:
    """The ring of some robots. `reach`: the most steps between neighbours, on either side."""

    def __init__(self, robots: Iterable[str], reach: int) -> None:
        self._keys = sorted((place(robot), robot) for robot in robots)
        self._reach = reach

    def _find(self, robot: str) -> tuple[int, bool]:
        """Return a robot's index, or the one that it would have, and whether it is in the ring."""
        key = (place(robot), robot)
        at = bisect_left(self._keys, key)
        return at, at < len(self._keys) and self._keys[at] == key

    def put(self, robot: str, is_in: bool) -> None:
        """Insert a robot into the ring, or remove it."""
        at, was_in = self._find(robot)
        if is_in and not was_in:
            self._keys.insert(at, (place(robot), robot))
        elif was_in and not is_in:
            del self._keys[at]

    def are_near(self, robot: str, other: str) -> bool:
        """True if `other`, which is in the ring, is a neighbour of `robot`."""
        count, (at, is_in) = len(self._keys), self._find(robot)
        if robot == other or count - is_in <= 2 * self._reach:
            return robot != other
        steps = (self._find(other)[0] - at) % count
        return steps <= self._reach - (not is_in) or steps >= count - self._reach

    def neighbours(self, robot: str) -> tuple[str, ...]:
        """The neighbours of a robot, sorted by id. If it is not in the ring: those that it would
        have.
        """
        keys, reach, (at, is_in) = self._keys, self._reach, self._find(robot)
        if len(keys) - is_in <= 2 * reach:
            return tuple(sorted(each for _, each in keys if each != robot))
        near = [*range(at - reach, at), *range(at + is_in, at + is_in + reach)]
        return tuple(sorted(keys[index % len(keys)][1] for index in near))


class RingGroup:
    """The group of the robot `me` in the ring of a mission's robots, among its `peers`.

    A group is at least as large as a robot and its neighbours together; the last one may be
    smaller.
    """

    def __init__(
        self, me: str, mission: Collection[str], peers: Mapping[str, Peer], reach: int
    ) -> None:
        self._me = me
        self._peers = peers
        keys = sorted((place(robot), robot) for robot in mission)
        size = max(2 * reach + 1, isqrt(max(0, len(keys) - 1)) + 1)
        self._starts = keys[::size]
        mine = self.number_of(me)
        names = [robot for _, robot in keys if self.number_of(robot) == mine]
        self.members = tuple(names if me in names else [*names, me])

    def number_of(self, robot: str) -> int:
        """The number of a robot's group, even if the mission does not name the robot."""
        return max(0, bisect_right(self._starts, (place(robot), robot)) - 1)

    def _healthy(self) -> list[str]:
        me, peers = self._me, self._peers
        return [r for r in self.members if r == me or (r in peers and peers[r].state.is_healthy)]

    def representatives(self) -> tuple[str, ...]:
        """The representatives of the group, as this robot sees it."""
        return tuple(self._healthy()[:REPRESENTATIVES])

    def reports(self) -> dict[str, SelfReport]:
        """The newest self-reports of the group's other healthy robots."""
        return {r: self._peers[r].report for r in self._healthy() if r != self._me}

    def all_report(self, digest: bytes) -> bool:
        """True if all other healthy robots of the group have joined and report this plan digest."""
        reports = self.reports().values()
        return all(each.has_joined and each.plan_digest == digest for each in reports)


class LocalHealth:
    """One robot's local health. Each sign of trouble makes it wait one detection time longer for
    silent robots, at most one per heartbeat period. One is taken off after the longest silence,
    then one after each detection time.

    `extra_us`: how much longer it waits. `better_at_us`: when that next decreases, None if it is 0.
    """

    def __init__(self, timing: Timing) -> None:
        self.extra_us = 0
        self.better_at_us: int | None = None
        self._timing = timing
        self._next_worse_us = 0

    def worsen(self, now_us: int) -> None:
        """Note trouble: this robot was slow, or others considered it dead."""
        if now_us >= self._next_worse_us:
            most_us = MAX_EXTRA_DETECTIONS * self._timing.detection_us
            self.extra_us = min(most_us, self.extra_us + self._timing.detection_us)
            self._next_worse_us = now_us + self._timing.heartbeat_us
            self.better_at_us = now_us + self._timing.max_silence_us

    def recover(self, now_us: int) -> None:
        """Reduce the extra wait if it is time."""
        if self.better_at_us is not None and now_us >= self.better_at_us:
            self.extra_us -= self._timing.detection_us
            self.better_at_us = now_us + self._timing.detection_us if self.extra_us else None


class PlanRecipients:
    """The robots that a robot reports its plans to: its representatives, and robots that wait."""

    def __init__(self, group: RingGroup, timing: Timing) -> None:
        self._group = group
        self._timing = timing
        # What was reported last and to which representatives; until when heartbeats repeat it.
        self._reported: tuple[bytes, bool, tuple[str, ...]] | None = None
        self._until_us = 0
        # The robots that were told that the group agrees, and the function that found them; and the
        # robots that still rely on an agreement that no longer holds.
        self._notified: set[str] = set()
        self._notified_waiting: Waiting | None = None
        self._stale: set[str] = set()

    def of_heartbeat(
        self, urgent: Urgent, number: int, waiting: Waiting | None, judges: Judges, now_us: int
    ) -> tuple[set[str], Mapping[str, SelfReport]]:
        """Return the robots that get heartbeat `number` because of plans, and what it relays to
        them.

        A repetition, in case of loss, goes to one representative after the other.
        """
        representatives = self._group.representatives()
        reported = urgent.digest, urgent.is_agreed, representatives
        if reported == self._reported:
            representatives = representatives[number % len(representatives) :][:1]
        else:
            self._reported = reported
            self._until_us = now_us + self._timing.repeat_offsets_us()[-1]
            waited = self._notified_waiting
            self._stale = self._notified & waited(judges) if self._notified and waited else set()
            self._notified = set()
        if waiting is None:
            return set(), {}
        is_new = now_us <= self._until_us
        found = set(self._stale) if is_new else set()
        if urgent.is_agreed:
            wait = waiting(judges)
            found |= wait if is_new else wait - self._notified
            self._notified |= wait
            self._notified_waiting = waiting
        relays = self._group.reports() if found else {}
        return (found.union(representatives) if is_new else found), relays


class RingDissemination(Dissemination):
    """The dissemination of the robot `me` in the large team of a mission's robots."""

    learns_joins_from_facts = True

    def __init__(
        self, me: str, peers: Mapping[str, Peer], timing: Timing, mission: Collection[str]
    ) -> None:
        super().__init__(me, peers)
        self._timing = timing
        self._mission = mission
        self._ring = Ring([me], timing.reach)
        self._group = RingGroup(me, mission, peers, timing.reach)
        self._plans = PlanRecipients(self._group, timing)
        self._health = LocalHealth(timing)
        # Robots that changed since the judged robots were computed; whether these must be
        # recomputed.
        self._changed: set[str] = set()
        self._is_stale = True
        self._suspects: set[str] = set()
        # All robots that may be present, in the order in which they take turns.
        self._in_turn: list[str] | None = None
        self._to_answer: set[str] = set()
        # Until when robots are checked; until when deaths are named that others may not have
        # declared.
        self._checked_until_us: dict[str, int] = {}
        self._named_until_us: dict[str, int] = {}
        self._next_denial_us = 0
        # Over the members: the sum of a hash of each joined incarnation.
        self._hashes: dict[str, int] = {}
        self._hash_sum = 0
        # Whether this robot's group agrees, and the arguments for which that was computed.
        self._is_agreed = False
        self._agreed_from: tuple[bytes, int] | None = None
        # What the last heartbeat reported; whether only plans have changed since neighbours had a
        # heartbeat, which shows them facts that they lack; until when a change is repeated to them.
        self._last: Urgent | None = None
        self._has_plan_only = self._regular_due = False
        self._repeats_until_us = 0
        self._sent_broadcast = 0
        self._next_broadcast_us = 0

    def set_team(self, team: Collection[str]) -> None:
        self._mission, self._in_turn, self._agreed_from = team, None, None
        self._group = RingGroup(self.me, team, self._peers, self._timing.reach)
        self._plans = PlanRecipients(self._group, self._timing)

    # -- the robots that this one judges ------------------------------------------------------

    def note(self, robot: str, peer: Peer) -> None:
        self._changed.add(robot)
        set_member(self.newcomers, robot, peer.state.is_healthy and not peer.report.has_joined)
        is_counted = peer.state.is_member and peer.report.has_joined
        self._hash_sum -= self._hashes.pop(robot, 0)
        if is_counted:
            self._hashes[robot] = _hash(robot, peer.incarnation)
            self._hash_sum += self._hashes[robot]
        self.plan_spacing_us = PLAN_SPACING_US * len(self._peers)

    @property
    def judged(self) -> Mapping[str, Peer]:
        self._follow()
        return self._judged

    def _follow(self) -> None:
        """Recompute the judged robots. A robot that is newly judged counts as heard just now."""
        if not (self._changed or self._is_stale):
            return
        peers, ring, me = self._peers, self._ring, self.me
        for robot in self._changed:
            state = peers[robot].state
            ring.put(robot, state.is_healthy)
            set_member(self._suspects, robot, state is State.SUSPECT)
            self._in_turn = None
            # A change far away in the ring makes no difference to this robot.
            self._is_stale |= robot in self._judged or ring.are_near(robot, me)
        self._changed.clear()
        if not self._is_stale:
            return
        self._is_stale = False
        checked = (r for r in self._checked_until_us if r in peers and peers[r].state.is_member)
        suspects = (robot for robot in self._suspects if ring.are_near(robot, me))
        mine = {*ring.neighbours(me), *checked, *suspects}
        for robot in self._judged.keys() - mine:
            peers[robot].is_judged = peers[robot].is_probed = False
        self._judged = {robot: peers[robot] for robot in sorted(mine)}
        for peer in self._judged.values():
            if not peer.is_judged:
                peer.last_heard_us = max(peer.last_heard_us, self.now_us)
            peer.is_judged = True

    def judges(self, robot: str) -> bool:
        return robot in self.judged or self._ring.are_near(robot, self.me)

    def witnesses(self, robot: str) -> list[str]:
        self._follow()
        near = self._ring.neighbours(self.me)
        return [name for name in self._ring.neighbours(robot) if name in near]

    def near(self) -> Mapping[str, Peer]:
        self._follow()
        return {robot: self._peers[robot] for robot in self._ring.neighbours(self.me)}

    # -- what comes in ------------------------------------------------------------------------

    def heard(self, robot: str, heartbeat: Heartbeat, before: State | None) -> None:
        if self._checked_until_us.pop(robot, None) is not None:
            self._is_stale = True
        if before is State.DEAD:
            self.broadcast_generation += 1  # robots cut off together with it may hold this one dead
        if before is None or self.me in heartbeat.relays:
            self._to_answer.add(robot)
        for suspicion in heartbeat.suspicions:
            if suspicion.robot == self.me:
                self._to_answer.add(robot)  # its ring may differ from this one's
                if suspicion.is_dead:
                    self._deny()

    def _deny(self) -> None:
        """Tell everybody that this robot is alive, as others have declared it dead. It may be slow.

        They report the death together and repeatedly, so one denial per heartbeat period is enough.
        """
        self._worsen()
        if self.now_us >= self._next_denial_us:
            self._next_denial_us = self.now_us + self._timing.heartbeat_us
            self.broadcast_generation += 1

    def heard_outdated(self, robot: str, heartbeat: Heartbeat) -> None:
        if not heartbeat.report.incarnation.counter:
            self._to_answer.add(robot)  # it restarts, and does not know its earlier incarnation yet

    def was_late(self) -> None:
        self._worsen()

    def _worsen(self) -> None:
        self._health.worsen(self.now_us)
        self.patience_us = self._health.extra_us

    def check(self, robot: str) -> None:
        """Listen to a robot for some time, and send it this robot's heartbeats."""
        if robot not in self._checked_until_us and len(self._checked_until_us) < MAX_CHECKED:
            self._checked_until_us[robot] = self.now_us + self._timing.max_detection_us
            self._is_stale = True

    def is_given_up(self, robot: str, peer: Peer, accusers: int) -> bool:
        """True if one accuser exists and this robot lost the token too; or if this robot does not
        judge it and more than half of the robots that do have declared it dead.
        """
        if peer.is_token_lost and accusers:
            return True
        return not peer.is_judged and accusers > len(self._ring.neighbours(robot)) // 2

    def declared_dead(self, robot: str, is_known: bool) -> None:
        self._named_until_us[robot] = self.now_us + self._timing.max_silence_us
        self.broadcast_generation += not is_known

    def expire(self) -> None:
        self._health.recover(self.now_us)
        self.patience_us = self._health.extra_us
        for ends_us in (self._checked_until_us, self._named_until_us):
            for robot in [r for r, until_us in ends_us.items() if self.now_us >= until_us]:
                del ends_us[robot]
                self._is_stale = True

    def ends_us(self) -> list[int]:
        better_at_us = self._health.better_at_us
        health_us = [] if better_at_us is None else [better_at_us]
        return [*self._checked_until_us.values(), *self._named_until_us.values(), *health_us]

    # -- what goes out ------------------------------------------------------------------------

    def to_name(self, suspected: Mapping[str, Peer]) -> list[tuple[str, Peer]]:
        self._follow()
        named = [(r, p) for r, p in suspected.items() if p.is_judged or r in self._named_until_us]
        return sorted(named, key=lambda each: each[0])[:MAX_SUSPICIONS]

    def members_digest(self, mine: Incarnation) -> bytes:
        total = (self._hash_sum + _hash(self.me, mine)) % (1 << 128)
        return hashlib.blake2b(total.to_bytes(16, "big"), digest_size=DIGEST_BYTES).digest()

    def agrees(self, digest: bytes, reports: int) -> bool:
        if (digest, reports) != self._agreed_from:
            self._agreed_from = digest, reports
            is_representative = bool(digest) and self.me in self._group.representatives()
            self._is_agreed = is_representative and self._group.all_report(digest)
        return self._is_agreed

    def is_plan_only(self, urgent: Urgent, is_regular_due: bool) -> bool:
        """Neighbours hear of plans with the first repetition, when the robots that act on them may
        have done so already. They hear of everything else at once, and again in the repetitions.
        """
        last = self._last
        if last is None:
            return False
        if urgent != last:
            self._regular_due = True
            same = urgent._replace(digest=last.digest, is_agreed=last.is_agreed)
            self._has_plan_only = same == last
            if not self._has_plan_only:
                self._repeats_until_us = self.now_us + self._timing.repeat_offsets_us()[-1]
        elif self._regular_due or self.now_us <= self._repeats_until_us:
            self._regular_due = False
            return False
        is_for_all = urgent.request is not None or urgent.broadcast != self._sent_broadcast
        return self._has_plan_only and not is_for_all and not is_regular_due

    def route(
        self, urgent: Urgent, number: int, plan_only: bool, is_new: bool, waiting: Waiting | None
    ) -> Route:
        now_us, last, self._last = self.now_us, self._last, urgent
        self._follow()
        judges = self._ring.neighbours
        found, relays = self._plans.of_heartbeat(urgent, number, waiting, judges, now_us)
        has_sought = last is not None and last.request is not None
        is_to_all = last is None or has_sought or urgent.request is not None
        is_to_all |= last is not None and last.is_leaving is not urgent.is_leaving
        if urgent.broadcast != self._sent_broadcast and now_us >= self._next_broadcast_us:
            # At most once per period: a team in trouble must not be loaded further.
            self._sent_broadcast = urgent.broadcast
            self._next_broadcast_us = now_us + self._timing.heartbeat_us
            # If others declare a newcomer dead, they mean an earlier incarnation.
            is_to_all |= not is_new
        found.update(member for _, member in urgent.answered)
        if plan_only:
            return Route(tuple(sorted(found - {self.me})), relays)
        near = self._near_recipients(number, is_new)
        return Route(None if is_to_all else tuple(sorted(self._present(found | near))), relays)

    def _near_recipients(self, number: int, is_new: bool) -> set[str]:
        """Return the robots that get a heartbeat whatever it reports.

        Includes all that await an answer.
        """
        answered, self._to_answer = self._to_answer, set()
        judged, peers = self._judged, self._peers
        found = {*self._ring.neighbours(self.me), *judged, *self._checked_until_us, *answered}
        for robot, peer in judged.items():
            if peer.is_probed:
                found.update(self._ring.neighbours(robot))
        if self._in_turn is None:
            self._in_turn = sorted(self._present({*peers, *self._mission}))
        found.update(self._some_of(self._in_turn, number, 1))
        if is_new:
            unheard = [r for r in self._in_turn if r not in peers or peers[r].heartbeat is None]
            found.update(self._some_of(unheard, number, SOUGHT_AT_A_TIME))
        return found

    def _some_of(self, robots: Sequence[str], number: int, count: int) -> list[str]:
        """Pick other robots for each number. Robots that started together begin differently."""
        begin = bisect_left(robots, self.me) + number * count
        return [robots[(begin + k) % len(robots)] for k in range(min(count, len(robots)))]

    def _present(self, robots: Collection[str]) -> set[str]:
        """Return those of the robots that have not left, without this one."""
        peers = self._peers
        left = {r for r in robots if r in peers and peers[r].state is State.LEFT}
        return set(robots) - left - {self.me}


@lru_cache(maxsize=4_096)
def _hash(robot: str, incarnation: Incarnation) -> int:
    text = f"{robot} {incarnation}"
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=16).digest(), "big")
