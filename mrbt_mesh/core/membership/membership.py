"""Which robots are alive: one robot's view of the others, from heartbeats, relays, suspicions and
tokens.

Heartbeats decide, liveliness tokens are hints. A robot judges the silence of those that it hears
(`dissemination`). Every heartbeat relays the newest self-report of each of them, and the sender's
suspicions: a robot that any of its neighbours still hears is alive for all of them. In a team with
keys a relay counts only with the signature of the robot that it is about (`signed_reports`).
`failure_detector` decides when a silent robot is suspected and declared dead. A death is a
judgement about one incarnation; a newer heartbeat of that incarnation revives it.

Where robots are clients of routers, a token is lost for everybody when its robot's process ends,
and also when the router dies that the robot was linked to, or the way to that router. So the router
is asked: a lost token counts only if it still answers, and has no link to the robot any more.

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
    """One robot's view of the others. `me` never appears in it; it is empty for an observer.

    `team`: the robots of the mission, which decide who hears whom (`around`); an observer hears
    everybody. `member_changes` grows with every change of a state, and of who has joined;
    `suspicion_changes` with every token that comes or goes and every suspicion of others;
    `report_changes` when a robot reports another plan or result. Until `next_detection_us`, and
    while none of them changes, `detect_failures` would find nothing new. `false_relays`: the robots
    of which the last heartbeat or view relayed a report that they have not signed.
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
        # The peers that this robot suspects; the robots that the last heartbeats of others suspect.
        self._suspected: dict[str, Peer] = {}
        self._suspected_by: dict[str, set[str]] = {}
        # Members that others have declared dead, and robots whose token was lost here.
        self._accused: set[str] = set()
        self._token_lost: set[str] = set()
        # Lost tokens about which a router has been asked.
        self._asked: dict[str, Incarnation] = {}

    def set_team(self, team: Collection[str]) -> None:
        """The robots of a revision of the mission. A small team does not become a large one."""
        self.around.set_team(team)

    # -- what comes in ------------------------------------------------------------------------

    def is_new_relay(self, row: list[Any]) -> bool:
        """Whether a relay [robot, counter, nonce, number, ...] may hold more than is known."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.report.number or (counter, nonce) != peer.incarnation

    def receive_heartbeat(self, robot: str, heartbeat: Heartbeat, now_us: int) -> bool:
        """Take in a heartbeat that came from `robot` itself; False if it is outdated."""
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
        """Take in a self-report, from the robot's own `heartbeat` or else relayed."""
        peer = self.peers.get(robot)
        # A relay of a robot that this one does not judge may be older than its death.
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
            self._note_change(robot, peer)
        if heartbeat is not None:
            self._take_own_heartbeat(robot, peer, heartbeat)
        elif is_proof and (
            peer.state is State.DEAD or (peer.state is State.SUSPECT and not peer.is_token_lost)
        ):
            self._set(robot, peer, State.ALIVE)
        return True

    def _take_own_heartbeat(self, robot: str, peer: Peer, heartbeat: Heartbeat) -> None:
        """Only the robot itself takes back a lost token: a relay may be older than the loss."""
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
        """A robot's new life is heard over the same network as the one before."""
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
        self._note_change(robot, peer)
        return peer

    def _take_news(self, peer: Peer, now_us: int) -> None:
        """A newer report of the same incarnation has arrived."""
        if peer.is_judged:  # the silence of a dead robot shows nothing of the network
            self._detector.learn_arrival(peer, now_us)
        peer.is_probed = False
        peer.declared_dead_by.clear()
        # The silence limit may have become shorter.
        self.next_detection_us = min(self.next_detection_us, now_us + peer.probe_after_us)

    def _take_suspicions(self, robot: str, suspicions: tuple[Suspicion, ...]) -> None:
        """What a robot suspects now, in place of what it suspected before."""
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
        """A robot's own facts show that it has joined, perhaps in a life that is new here."""
        if self.around.learns_joins_from_facts:
            self.around.now_us = now_us
            self._take_report(robot, report, now_us, None)

    def receive_token(
        self, robot: str, incarnation: Incarnation, is_held: bool, router: str = ""
    ) -> bool:
        """A liveliness token came (`is_held`) or went. Its presence proves nothing.

        Returns whether the robot's `router`, if it has one, must be asked what that means.
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
        """A router was asked about a lost token. `is_linked`: see `RouterAnswered`."""
        if self._asked.get(robot) == incarnation:
            del self._asked[robot]
            if is_linked is False:
                self.receive_token(robot, incarnation, False)

    def allow_for_own_lag(self, lag_us: int, now_us: int) -> None:
        """This robot was late by `lag_us`: messages may wait unread, so suspect nobody for it.

        Source: Lifeguard's local health (Dadgar, Phillips, Currey 2018), as a shift of what was
        last heard.
        """
        self.around.now_us = now_us
        self.around.was_late()
        for peer in self.peers.values():
            peer.last_heard_us = min(now_us, peer.last_heard_us + lag_us)

    # -- failure detection --------------------------------------------------------------------

    def needs_detection(self, now_us: int) -> bool:
        """Whether `detect_failures` could find something new."""
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
        # Newer news has put it off.
        self.next_detection_us = self._next_due_us(now_us)
        return False

    def _next_due_us(self, now_us: int) -> int:
        ends_us = (at_us for at_us in self.around.ends_us() if at_us > now_us)
        return min([self._detector.next_due_us(now_us), *ends_us])

    def detect_failures(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect silent robots, declare suspects dead; (robot, before, after) of each change."""
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
            self._note_change(robot, peer)

    def _note_change(self, robot: str, peer: Peer) -> None:
        """A robot is new, has joined, or is in another state."""
        self.member_changes += 1
        if peer.report.has_joined and peer.state.is_member:
            self._joined[robot] = peer.incarnation
        else:
            self._joined.pop(robot, None)
        self.around.note(robot, peer)

    # -- what is known ------------------------------------------------------------------------

    def members(self) -> dict[str, Incarnation]:
        """The robots that a plan counts on: joined, neither dead nor left, suspects included."""
        return dict(sorted(self._joined.items()))

    @property
    def joined_count(self) -> int:
        """How many others are members."""
        return len(self._joined)

    @property
    def present_count(self) -> int:
        """How many others there are, joined or not, neither dead nor left."""
        return sum(peer.state.is_member for peer in self.peers.values())

    def has_returned(self, robot: str, now_us: int) -> bool:
        """Whether a robot was not heard until a short while ago: what it saw alone is news."""
        peer = self.peers.get(robot)
        return peer is not None and now_us < peer.returned_us + self.timing.max_detection_us

    @property
    def heard_count(self) -> int:
        """How many others are healthy and have joined."""
        return sum(p.state.is_healthy and p.report.has_joined for p in self.peers.values())

    def in_reach(self, now_us: int) -> frozenset[str]:
        """The others that are healthy, and whose own heartbeats arrive, not only relays."""
        since_us = now_us - self.timing.max_detection_us
        return frozenset(
            robot
            for robot, peer in self.peers.items()
            if peer.state.is_healthy and peer.heartbeat is not None and peer.beat_us >= since_us
        )

    def all_report_plan(self, digest: bytes) -> bool:
        """Whether every healthy robot reports this plan digest.

        One that is still joining for the first time reports none, so it is waited for too.
        """
        for peer in self.peers.values():
            report = peer.report
            if peer.state.is_healthy and not (report.has_joined and report.plan_digest == digest):
                return False
        return True

    def all_report_result(self, result: int, digest: bytes | None = None) -> bool:
        """Whether every member that this robot judges reports this mission status.

        And, unless it is None, this digest of its plan. Suspects included. A robot that has missed
        the end can hear of it from its neighbours, who stay until it has.
        """
        return all(
            peer.report.result == result and digest in (None, peer.report.plan_digest)
            for peer in self.around.judged.values()
            if peer.report.has_joined
        )

    def silent_since_us(self) -> int | None:
        """When a robot that is dead by now was heard last, the latest of them."""
        dead = (peer for peer in self.peers.values() if peer.state is State.DEAD)
        return max((peer.last_heard_us for peer in dead), default=None)

    def clock_offsets_us(self) -> list[int]:
        """By how much the wall clocks of healthy robots are ahead of this robot's monotonic clock,
        as far as they were heard. Each is too small by the time that its heartbeat took.
        """
        offsets_us = (p.clock_offset_us for p in self.peers.values() if p.state.is_healthy)
        return [each_us for each_us in offsets_us if each_us is not None]

    def forget_clocks(self) -> None:
        """Another clock of this robot was set: what others' clocks show has to be heard anew."""
        for peer in self.peers.values():
            peer.clock_offset_us = None

    # -- where others hold other robots for alive ---------------------------------------------

    def view(self, mine: SelfReport) -> dict[str, SelfReport]:
        """The newest self-reports of the healthy robots, and this robot's own."""
        reports = {r: peer.report for r, peer in self.peers.items() if peer.state.is_healthy}
        return dict(sorted((reports | {self.me: mine}).items()))

    def compare_view(
        self,
        source: str,
        reports: Mapping[str, SelfReport],
        lives: Mapping[str, Incarnation],
        now_us: int,
    ) -> None:
        """Another robot's `view`: check the robots of which this one knows otherwise.

        `lives`: those that have joined by their own facts. Of them a report need not be signed.
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

    # -- what this robot's heartbeats carry ---------------------------------------------------

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
        """Whether the sender probes a robot of which this one has news: another one, or itself."""
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
