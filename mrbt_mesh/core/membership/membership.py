"""One robot's view of which other robots are alive, from heartbeats, relays, suspicions and
liveliness tokens.

Heartbeats decide; liveliness tokens are only hints. A robot judges the silence of the robots that
it hears (`dissemination`). Every heartbeat relays the newest self-report of each of them and the
sender's suspicions, so a robot that any of its neighbours still hears is alive for all of them. In
a team with keys, a relayed report counts only if it is signed by the robot that it is about
(`signed_reports`). `failure_detector` decides when a silent robot is suspected and declared dead. A
death applies to one incarnation; a newer heartbeat of the same incarnation revives it.

Where robots are clients of routers, every robot loses a token when the robot's process ends, but
also when its router dies or becomes unreachable. So the router is asked: a lost token counts only
if the router still answers and has no link to the robot any more.

Source: SWIM (Das, Gupta, Motivala 2002); relays on heartbeats are its indirect probe.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.dissemination import Dissemination
from mrbt_mesh.core.membership.failure_detector import PROBE_SHARE, FailureDetector, is_silent
from mrbt_mesh.core.membership.peer import ArrivalHistory, Peer, State, set_member
from mrbt_mesh.core.membership.ring import RingDissemination
from mrbt_mesh.core.membership.signed_reports import SignedReports, joined_report
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport, Suspicion


class Membership:
    """One robot's view of the others. It never contains `me`, which is empty for an observer.

    `team`: the robots of the mission, which decide who hears whom (`around`); an observer hears
    everybody. `member_changes` grows when a robot's state changes or a robot joins;
    `suspicion_changes` when a token appears or disappears and when others change their suspicions;
    `report_changes` when a robot reports another plan or result. Until `next_detection_us`, and
    while neither `member_changes` nor `suspicion_changes` grows, `detect_failures` finds nothing
    new. `false_relays`: the robots about which the last heartbeat or view relayed a report without
    their valid signature.
    """

    def __init__(
        self,
        me: str,
        timing: Timing,
        team: Collection[str] = (),
        reports: SignedReports | None = None,
    ) -> None:
        self.me = me
        self.reports = reports or SignedReports(None, "")
        self.false_relays: list[str] = []
        self.timing = timing
        self.peers: dict[str, Peer] = {}
        self.around = (
            Dissemination(me, self.peers)
            if not me or timing.all_are_neighbours(len(team))
            else RingDissemination(me, self.peers, timing, team)
        )
        self.member_changes = 0
        self.suspicion_changes = 0
        self.report_changes = 0
        self.next_detection_us = 0
        self._detector = FailureDetector(timing, self.peers, self.around, is_observer=not me)
        self._detected_at_changes = -1
        self._joined: dict[str, Incarnation] = {}
        # Peers that this robot suspects; robot -> the robots that its last heartbeat suspects.
        self._suspected: dict[str, Peer] = {}
        self._suspected_by: dict[str, set[str]] = {}
        # Members that others have declared dead, and robots whose token this robot has lost.
        self._accused: set[str] = set()
        self._token_lost: set[str] = set()
        # Lost tokens that a router was asked about.
        self._asked: dict[str, Incarnation] = {}

    def set_team(self, team: Collection[str]) -> None:
        """Set the robots of a mission revision. A small team does not become a large one."""
        self.around.set_team(team)

    # -- what comes in ------------------------------------------------------------------------

    def is_new_relay(self, row: list[Any]) -> bool:
        """Return False if a relay [robot, counter, nonce, number, ...] is certainly not news."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.report.number or (counter, nonce) != peer.incarnation

    def receive_heartbeat(self, robot: str, heartbeat: Heartbeat, now_us: int) -> bool:
        """Process a heartbeat received from `robot` itself. Returns False if it is outdated."""
        around, peers = self.around, self.peers
        around.now_us = now_us
        # Whatever a router answers about its token is outdated by now.
        self._asked.pop(robot, None)
        peer = peers.get(robot)
        is_new = peer is None or peer.incarnation != heartbeat.report.incarnation
        before = None if peer is None or is_new else peer.state
        if not self._take_report(robot, heartbeat.report, now_us, heartbeat):
            around.heard_outdated(robot, heartbeat)
            return False
        around.heard(robot, heartbeat, before)
        self.false_relays.clear()
        for name, report in heartbeat.relays.items():
            known = peers.get(name)
            if known is None:
                if name != self.me:
                    self._take_relay(name, report, now_us)
            # Most relays bring nothing new.
            elif report is not known.report and (
                report.number > known.report.number
                if report.incarnation == known.incarnation
                else report.incarnation > known.incarnation
            ):
                self._take_relay(name, report, now_us)
        if heartbeat.suspicions or robot in self._suspected_by:
            self._take_suspicions(robot, heartbeat.suspicions)
        return True

    def _take_relay(self, robot: str, report: SelfReport, now_us: int) -> None:
        if self.reports.is_authentic(robot, report):
            self._take_report(robot, report, now_us, None)
        else:
            self.false_relays.append(robot)

    def _take_report(
        self, robot: str, report: SelfReport, now_us: int, heartbeat: Heartbeat | None
    ) -> bool:
        """Process a self-report, from the robot's own `heartbeat` or, if that is None, relayed."""
        peer = self.peers.get(robot)
        # A relayed report of a robot that this one does not judge may be older than its death.
        is_proof = heartbeat is not None or self.around.judges(robot)
        if peer is None or report.incarnation != peer.incarnation:
            if peer is not None and report.incarnation < peer.incarnation:
                return False
            peer = self._add_incarnation(robot, report, peer, now_us)
        elif report.number > peer.report.number:
            if is_proof:
                self._take_news(peer, now_us)
        elif heartbeat is not None and report.number == peer.report.number:
            peer.heartbeat, peer.position = heartbeat, heartbeat.position
            return peer.state.is_member
        else:
            return False
        before, peer.report = peer.report, report
        if is_proof:
            peer.last_heard_us = now_us
        if report.plan_digest != before.plan_digest or report.result != before.result:
            self.report_changes += 1
        if report.has_joined != before.has_joined:
            self.note_change(robot, peer)
        if heartbeat is not None:
            self._take_own_heartbeat(robot, peer, heartbeat)
        elif is_proof and (
            peer.state is State.DEAD or (peer.state is State.SUSPECT and not peer.is_token_lost)
        ):
            self._set(robot, peer, State.ALIVE)
        return True

    def _take_own_heartbeat(self, robot: str, peer: Peer, heartbeat: Heartbeat) -> None:
        """Process the rest of a robot's own heartbeat. Only that restores a lost token, since a
        relayed report may be older than the loss.
        """
        peer.heartbeat, peer.position = heartbeat, heartbeat.position
        peer.beat_us = peer.last_heard_us
        if heartbeat.unix_us is not None:
            peer.clock_offset_us = heartbeat.unix_us - peer.last_heard_us
        if peer.is_token_lost or peer.token_lost_by:
            peer.is_token_lost = False
            self._token_lost.discard(robot)
            peer.token_lost_by.clear()
            self.suspicion_changes += 1
        if heartbeat.is_leaving:
            self._set(robot, peer, State.LEFT)
        elif not peer.state.is_healthy:
            self._set(robot, peer, State.ALIVE)

    def _add_incarnation(
        self, robot: str, report: SelfReport, before: Peer | None, now_us: int
    ) -> Peer:
        """Add a new incarnation of a robot. It keeps the arrival history of the one before, since
        it is heard over the same network.
        """
        arrivals = before.arrivals if before else ArrivalHistory.of_new_robot(self.timing)
        limit_us = self.timing.silence_limit_us(arrivals.overdue_permille)
        self._suspected.pop(robot, None)
        self._token_lost.discard(robot)
        probe_after_us = limit_us // PROBE_SHARE
        peer = Peer(report.incarnation, report, now_us, arrivals, limit_us, probe_after_us)
        if before is None or not before.state.is_member:
            peer.returned_us = now_us
        else:
            peer.returned_us = before.returned_us
        self.peers[robot] = peer
        self.note_change(robot, peer)
        return peer

    def _take_news(self, peer: Peer, now_us: int) -> None:
        """Note that a newer report of the same incarnation has arrived."""
        if peer.is_judged:  # a dead robot's silence says nothing about the network
            self._detector.learn_arrival(peer, now_us)
        peer.is_probed = False
        peer.declared_dead_by.clear()
        # The silence limit may have become shorter.
        self.next_detection_us = min(self.next_detection_us, now_us + peer.probe_after_us)

    def _take_suspicions(self, robot: str, suspicions: tuple[Suspicion, ...]) -> None:
        """Replace what a robot suspected before by what it suspects now."""
        for suspicion in suspicions:
            peer = self.peers.get(suspicion.robot)
            if peer is not None and suspicion.incarnation == peer.incarnation:
                self.suspicion_changes += set_member(
                    peer.token_lost_by, robot, suspicion.is_token_lost
                ) + set_member(peer.declared_dead_by, robot, suspicion.is_dead)
                if suspicion.is_dead:
                    self._accused.add(suspicion.robot)
        suspected = {suspicion.robot for suspicion in suspicions}
        for name in self._suspected_by.pop(robot, set()) - suspected:
            peer = self.peers.get(name)
            if peer is not None and (robot in peer.token_lost_by or robot in peer.declared_dead_by):
                peer.token_lost_by.discard(robot)
                peer.declared_dead_by.discard(robot)
                self.suspicion_changes += 1
        if suspected:
            self._suspected_by[robot] = suspected

    def receive_join(self, robot: str, report: SelfReport, now_us: int) -> None:
        """Note that a robot's own facts show that it has joined, perhaps in a new incarnation."""
        if self.around.learns_joins_from_facts:
            self.around.now_us = now_us
            self._take_report(robot, report, now_us, None)

    def receive_token(
        self, robot: str, incarnation: Incarnation, is_held: bool, router: str = ""
    ) -> bool:
        """Note that a liveliness token has appeared (`is_held`) or disappeared. Its presence proves
        nothing.

        Returns True if the robot's `router` must first be asked why the token has disappeared.
        """
        self._asked.pop(robot, None)
        if router and not is_held:
            self._asked[robot] = incarnation
            return True
        peer = self.peers.get(robot)
        if peer is not None and peer.incarnation == incarnation:
            peer.is_token_lost = not is_held
            set_member(self._token_lost, robot, not is_held)
            self.suspicion_changes += 1
        return False

    def router_answered(self, robot: str, incarnation: Incarnation, is_linked: bool | None) -> None:
        """Process a router's answer about a lost token. `is_linked`: see `RouterAnswered`."""
        if self._asked.get(robot) == incarnation:
            del self._asked[robot]
            if is_linked is False:
                self.receive_token(robot, incarnation, False)

    def allow_for_own_lag(self, lag_us: int, now_us: int) -> None:
        """Allow for this robot having been late by `lag_us`: messages may wait unread, so the delay
        must not count as silence of others.

        Source: Lifeguard's local health (Dadgar, Phillips, Currey 2018), applied by shifting
        `last_heard_us`.
        """
        self.around.now_us = now_us
        self.around.was_late()
        for peer in self.peers.values():
            peer.last_heard_us = min(now_us, peer.last_heard_us + lag_us)

    # -- failure detection --------------------------------------------------------------------

    def needs_detection(self, now_us: int) -> bool:
        """True if `detect_failures` could find something new."""
        if self._detected_at_changes != self.member_changes + self.suspicion_changes:
            return True
        if now_us < self.next_detection_us:
            return False
        self.around.now_us = now_us
        judged = self.around.judged
        if self._suspected or any(is_silent(peer, now_us) for peer in judged.values()):
            return True
        if any(at_us <= now_us for at_us in self.around.ends_us()):
            return True
        # Newer reports have postponed it.
        self.next_detection_us = self._next_due_us(now_us)
        return False

    def _next_due_us(self, now_us: int) -> int:
        ends_us = (at_us for at_us in self.around.ends_us() if at_us > now_us)
        return min([self._detector.next_due_us(now_us), *ends_us])

    def detect_failures(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect silent robots and declare suspects dead. Returns (robot, before, after) of each
        change.
        """
        if not self.needs_detection(now_us):
            return []
        peers, around, detector = self.peers, self.around, self._detector
        around.now_us = now_us
        around.expire()
        before: dict[str, State] = {}
        for robot in detector.find_suspects(self._token_lost, now_us):
            before[robot] = peers[robot].state
            self._set(robot, peers[robot], State.SUSPECT)
        for robot in detector.find_dead({*self._suspected, *self._accused}, now_us):
            peer = peers[robot]
            before.setdefault(robot, peer.state)
            if peer.is_judged:
                is_known = peer.is_token_lost and detector.accusers(peer) > 0
                around.declared_dead(robot, is_known)
            self._set(robot, peer, State.DEAD)
            peer.is_probed = False
            self._accused.discard(robot)
        self._detected_at_changes = self.member_changes + self.suspicion_changes
        self.next_detection_us = self._next_due_us(now_us)
        return [
            (robot, state, peers[robot].state)
            for robot, state in sorted(before.items())
            if state is not peers[robot].state
        ]

    def _set(self, robot: str, peer: Peer, state: State) -> None:
        if peer.state is not state:
            if peer.state is State.DEAD:
                peer.returned_us = self.around.now_us
            peer.state = state
            if state.is_suspected:
                self._suspected[robot] = peer
            else:
                self._suspected.pop(robot, None)
            self.note_change(robot, peer)

    def note_change(self, robot: str, peer: Peer) -> None:
        """Note that a robot is new, has joined, or has changed its state."""
        self.member_changes += 1
        if peer.report.has_joined and peer.state.is_member:
            self._joined[robot] = peer.incarnation
        else:
            self._joined.pop(robot, None)
        self.around.note(robot, peer)

    # -- queries ------------------------------------------------------------------------------

    def members(self) -> dict[str, Incarnation]:
        """The robots that a plan counts on: joined and neither dead nor left. Includes suspects."""
        return dict(sorted(self._joined.items()))

    @property
    def joined_count(self) -> int:
        """The number of other robots that are members."""
        return len(self._joined)

    @property
    def present_count(self) -> int:
        """The number of other robots that are neither dead nor left, joined or not."""
        return sum(peer.state.is_member for peer in self.peers.values())

    def has_returned(self, robot: str, now_us: int) -> bool:
        """True if a robot was first heard, or returned from the dead, within `max_detection_us`.
        What it saw while it was away is news.
        """
        peer = self.peers.get(robot)
        return peer is not None and now_us < peer.returned_us + self.timing.max_detection_us

    @property
    def heard_count(self) -> int:
        """The number of other robots that are healthy and have joined."""
        return sum(p.state.is_healthy and p.report.has_joined for p in self.peers.values())

    def in_reach(self, now_us: int) -> frozenset[str]:
        """The healthy robots whose own heartbeats arrive, not only relays of their reports."""
        since_us = now_us - self.timing.max_detection_us
        return frozenset(
            robot
            for robot, peer in self.peers.items()
            if peer.state.is_healthy and peer.heartbeat is not None and peer.beat_us >= since_us
        )

    def all_report_plan(self, digest: bytes) -> bool:
        """True if every healthy robot reports this plan digest.

        A robot that is still joining reports none, so this stays False until it has joined.
        """
        for peer in self.peers.values():
            report = peer.report
            if peer.state.is_healthy and not (report.has_joined and report.plan_digest == digest):
                return False
        return True

    def all_report_result(self, result: int, digest: bytes | None = None) -> bool:
        """True if every joined robot that this one judges reports this mission status, and also
        this plan digest unless that is None.

        Includes suspects. A robot that has missed the end can hear of it from its neighbours, which
        stay until it has.
        """
        return all(
            peer.report.result == result and digest in (None, peer.report.plan_digest)
            for peer in self.around.judged.values()
            if peer.report.has_joined
        )

    def silent_since_us(self) -> int | None:
        """The latest time at which a robot that is now dead was heard, None if no robot is dead."""
        dead = (peer for peer in self.peers.values() if peer.state is State.DEAD)
        return max((peer.last_heard_us for peer in dead), default=None)

    def clock_offsets_us(self) -> list[int]:
        """The known offsets of healthy robots' wall clocks from this robot's monotonic clock.

        Each is too small by the time that the heartbeat took to arrive.
        """
        offsets_us = (p.clock_offset_us for p in self.peers.values() if p.state.is_healthy)
        return [each_us for each_us in offsets_us if each_us is not None]

    def forget_clocks(self) -> None:
        """Forget all clock offsets, because this robot's own clock was set."""
        for peer in self.peers.values():
            peer.clock_offset_us = None

    # -- comparing views with other robots ----------------------------------------------------

    def view(self, mine: SelfReport) -> dict[str, SelfReport]:
        """The newest self-reports of the healthy robots, including this robot's own, `mine`."""
        reports = {r: peer.report for r, peer in self.peers.items() if peer.state.is_healthy}
        return dict(sorted((reports | {self.me: mine}).items()))

    def compare_view(
        self,
        source: str,
        reports: Mapping[str, SelfReport],
        lives: Mapping[str, Incarnation],
        now_us: int,
    ) -> None:
        """Compare another robot's `view` with this one's, and check the robots where they differ.

        `lives`: the incarnations that have joined by their own facts. Their reports need not be
        signed.
        """
        self.around.now_us = now_us
        self.false_relays.clear()
        for robot, report in reports.items():
            known = self.peers.get(robot)
            if robot == self.me or (known is not None and report.incarnation < known.incarnation):
                continue
            if robot == source:  # the answer itself is proved to be its own
                self._take_report(robot, report, now_us, None)
            elif not report.signature and lives.get(robot) == report.incarnation:
                self._take_report(robot, joined_report(report.incarnation), now_us, None)
            elif known is None or (report.incarnation, report.number) > (
                known.incarnation,
                known.report.number,
            ):
                self._take_relay(robot, report, now_us)
            peer = self.peers.get(robot)
            if peer is None:
                continue
            if peer is not known or peer.state.is_suspected:
                self.around.check(robot)
        for robot, peer in sorted(self.peers.items()):
            if peer.state.is_healthy and robot not in reports and robot != source:
                self.around.check(robot)
        self.next_detection_us = now_us

    # -- contents of this robot's heartbeats --------------------------------------------------

    def relays(self) -> dict[str, SelfReport]:
        """The relays of the next heartbeat, sorted by robot."""
        may_be, judged = self.reports.may_be_relayed, sorted(self.around.judged.items())
        healthy = ((robot, peer.report) for robot, peer in judged if peer.state.is_healthy)
        return {robot: report for robot, report in healthy if may_be(report)}

    def suspicions(self) -> tuple[Suspicion, ...]:
        """The suspicions of the next heartbeat, sorted by robot."""
        if not self._suspected:
            return ()
        return tuple(
            Suspicion(
                robot,
                peer.incarnation,
                is_token_lost=peer.is_token_lost,
                is_dead=peer.state is State.DEAD,
                is_probe=peer.is_probed,
                report=peer.report if peer.report.signature else None,
            )
            for robot, peer in self.around.to_name(self._suspected)
        )

    @property
    def has_suspects(self) -> bool:
        """Whether a member is suspected."""
        return any(peer.state is State.SUSPECT for peer in self._suspected.values())

    @property
    def is_probing(self) -> bool:
        """Whether a member has been silent for too long."""
        return any(peer.is_probed for peer in self._suspected.values())

    def can_answer_probe(self, heartbeat: Heartbeat, mine: Incarnation) -> bool:
        """True if the sender probes this robot, or a robot that is healthy for this one."""
        for suspicion in heartbeat.suspicions:
            if suspicion.is_probe:
                peer = self.peers.get(suspicion.robot)
                if suspicion.robot == self.me:
                    found = mine
                elif peer is not None and peer.state.is_healthy:
                    found = peer.incarnation
                else:
                    continue
                if found == suspicion.incarnation:
                    return True
        return False
