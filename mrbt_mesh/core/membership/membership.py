"""Who is alive: one robot's view of the others, from heartbeats, relays, suspicions and tokens.

Heartbeats decide, liveliness tokens are hints. A robot judges the silence of its neighbours
(`neighbourhood`): in a small team of everybody, in a larger one of six. Every heartbeat relays the
newest self-report of each neighbour that its sender hears, and its suspicions: a robot that any of
its neighbours still hears is alive for all of them. `failure_detector` says when a silent robot is
suspected and declared dead. Who declares a neighbour dead tells everybody, and most of a robot's
neighbours are believed. Death is a judgement about one incarnation; a newer heartbeat of that
incarnation revives it.

Source: SWIM (Das, Gupta, Motivala 2002); relays on heartbeats are its indirect probe.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import chain
from typing import Any

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.arrival_history import ArrivalHistory
from mrbt_mesh.core.membership.failure_detector import PROBE_SHARE, FailureDetector, is_silent
from mrbt_mesh.core.membership.local_health import LocalHealth
from mrbt_mesh.core.membership.members import Members
from mrbt_mesh.core.membership.neighbourhood import Neighbourhood
from mrbt_mesh.core.membership.peer import Peer, State, set_member
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport, Suspicion

# Of a large team a heartbeat names so many suspicions at most.
MAX_SUSPICIONS = 32


class Membership:
    """One robot's view of the others. `me` never appears in it.

    `member_changes` grows with every change of who is alive, `suspicion_changes` with every token
    that comes or goes and every suspicion of others, `report_changes` when a robot reports another
    plan or result, `news_changes` when everybody is to hear from this robot at once. Until
    `next_detection_us`, and while nothing of it changes, `detect_failures` would find nothing new.

    `reach` of its neighbours: that of the timing, unless it hears everybody as an observer does.
    """

    def __init__(self, me: str, timing: Timing, reach: int | None = None) -> None:
        self.me = me
        self.timing = timing
        self.peers: dict[str, Peer] = {}
        reach = timing.reach if reach is None else reach
        self._neighbourhood = Neighbourhood(me, timing, self.peers, reach)
        self._now_us = 0
        self.member_changes = 0
        self.suspicion_changes = 0
        self.report_changes = 0
        self.news_changes = 0
        self.next_detection_us = 0
        self._detector = FailureDetector(timing, is_observer=not me)
        self._detected_at_changes = -1
        # Whom the last heartbeats of robots suspected, and the peers that this robot suspects.
        self._suspected_by: dict[str, set[str]] = {}
        self._suspected: dict[str, Peer] = {}
        # Until when this robot tells of those that it has declared dead, where not all do.
        self._told_dead_until_us: dict[str, int] = {}
        self._health = LocalHealth(timing)
        self._next_denial_us = 0
        # Robots whose token is gone here, and live ones that others declare dead.
        self._token_lost: set[str] = set()
        self._accused: set[str] = set()
        self._alive = Members()

    @property
    def neighbourhood(self) -> Neighbourhood:
        """Whom this robot judges and sends its heartbeats to, by what it knows now."""
        self._neighbourhood.follow(self._now_us)
        return self._neighbourhood

    # -- what comes in ------------------------------------------------------------------------

    def is_new_relay(self, row: list[Any]) -> bool:
        """Whether a relay [robot, counter, nonce, number, ...] may tell more than is known."""
        robot, counter, nonce, number = row[:4]
        peer = self.peers.get(robot) if isinstance(robot, str) else None
        if peer is None or type(number) is not int:
            return True
        return number > peer.report.number or (counter, nonce) != peer.incarnation

    def receive_heartbeat(self, robot: str, heartbeat: Heartbeat, now_us: int) -> bool:
        """Take in a heartbeat that came from `robot` itself; False if it is old news."""
        self._now_us = now_us
        before = self.peers.get(robot)
        is_new = before is None or before.incarnation != heartbeat.report.incarnation
        if not self._take_report(robot, heartbeat.report, now_us, heartbeat):
            if not heartbeat.report.incarnation.counter:
                self.neighbourhood.answer(robot)  # it starts again, and has yet to hear of that
            return False
        if is_new or self.me in heartbeat.relays:
            self.neighbourhood.answer(robot)
        peers, me = self.peers, self.me
        for name, report in heartbeat.relays.items():
            known = peers.get(name)
            # Most relays tell nothing new.
            if known is None:
                if name != me:
                    self._take_report(name, report, now_us, None)
            elif report is not known.report and (
                report.number > known.report.number or report.incarnation != known.incarnation
            ):
                self._take_report(name, report, now_us, None)
        if heartbeat.suspicions or robot in self._suspected_by:
            self._take_suspicions(robot, heartbeat.suspicions)
        return True

    def _take_report(
        self, robot: str, report: SelfReport, now_us: int, heartbeat: Heartbeat | None
    ) -> bool:
        """Take in a self-report, from the robot's own `heartbeat` or else relayed."""
        peer = self.peers.get(robot)
        if peer is None or report.incarnation != peer.incarnation:
            if peer is not None and report.incarnation < peer.incarnation:
                return False
            peer = self._add_incarnation(robot, report, peer, now_us)
        elif report.number > peer.report.number:
            if heartbeat is not None or self.neighbourhood.judges(robot):
                self._take_news(peer, now_us)
        elif heartbeat is not None and report.number == peer.report.number:
            peer.heartbeat, peer.position = heartbeat, heartbeat.position
            return peer.state.is_member
        else:
            return False
        before, peer.report = peer.report, report
        # A relay of a robot that this one does not judge may be older than its death.
        is_proof = heartbeat is not None or self.neighbourhood.judges(robot)
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
        self.neighbourhood.heard(robot)
        if peer.state is State.DEAD and not self.neighbourhood.is_complete:
            self.news_changes += 1  # it, and others that it was with, may hold this one for dead
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
        limit_us = self._detector.silence_limit_us(arrivals.overdue_permille)
        self._suspected.pop(robot, None)
        self._token_lost.discard(robot)
        probe_after_us = limit_us // PROBE_SHARE
        peer = Peer(report.incarnation, report, now_us, arrivals, limit_us, probe_after_us)
        self.peers[robot] = peer
        self._note_change(robot, peer)
        return peer

    def _take_news(self, peer: Peer, now_us: int) -> None:
        """A newer report of the same incarnation has arrived."""
        if peer.is_judged:
            self._detector.learn_arrival(peer, now_us)
        peer.is_probed = False
        if peer.declared_dead_by:
            peer.declared_dead_by.clear()
        # The silence limit may have become shorter.
        probe_at_us = now_us + peer.probe_after_us
        if probe_at_us < self.next_detection_us:
            self.next_detection_us = probe_at_us

    def _take_suspicions(self, robot: str, suspicions: tuple[Suspicion, ...]) -> None:
        """What a robot suspects now, in place of what it suspected before."""
        for suspicion in suspicions:
            peer = self.peers.get(suspicion.robot)
            if suspicion.robot == self.me:
                self.neighbourhood.answer(robot)  # it may see another ring than this one
                if suspicion.is_dead:
                    self._was_accused()
            if peer is not None and suspicion.incarnation == peer.incarnation:
                self.suspicion_changes += set_member(
                    peer.token_lost_by, robot, suspicion.is_token_lost
                ) + set_member(peer.declared_dead_by, robot, suspicion.is_dead)
                if suspicion.is_dead and not self.neighbourhood.is_complete:
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

    def _was_accused(self) -> None:
        """Somebody holds this robot for dead: it tells everybody; it may itself be slow.

        Those who do so say it together and again: one answer in each heartbeat period is enough.
        """
        if not self.neighbourhood.is_complete:
            self._health.worsen(self._now_us)
            if self._now_us >= self._next_denial_us:
                self._next_denial_us = self._now_us + self.timing.heartbeat_us
                self.news_changes += 1

    def receive_report(self, robot: str, report: SelfReport, now_us: int) -> None:
        """A robot's own facts say that it has joined, in a life that may be new here."""
        self._now_us = now_us
        self._take_report(robot, report, now_us, None)

    def receive_token(self, robot: str, incarnation: Incarnation, is_held: bool) -> None:
        """A liveliness token came (`is_held`) or went. Its presence proves nothing."""
        peer = self.peers.get(robot)
        if peer is not None and peer.incarnation == incarnation:
            peer.is_token_lost = not is_held
            set_member(self._token_lost, robot, not is_held)
            self.suspicion_changes += 1

    def allow_for_own_lag(self, lag_us: int, now_us: int) -> None:
        """This robot was late by `lag_us`: messages may wait unread, so suspect nobody for it.

        Source: Lifeguard's local health (Dadgar, Phillips, Currey 2018), as a shift of what was
        last heard.
        """
        self._now_us = now_us
        if not self.neighbourhood.is_complete:
            self._health.worsen(now_us)
        for peer in self.peers.values():
            peer.last_heard_us = min(now_us, peer.last_heard_us + lag_us)

    # -- failure detection --------------------------------------------------------------------

    def needs_detection(self, now_us: int) -> bool:
        """Whether `detect_failures` could find something new."""
        if self._detected_at_changes != self.member_changes + self.suspicion_changes:
            return True
        if now_us < self.next_detection_us:
            return False
        self._now_us = now_us
        judged = self.neighbourhood.judged
        if self._suspected or any(is_silent(peer, now_us) for peer in judged.values()):
            return True
        if any(at_us <= now_us for at_us in self._ends_us()):
            return True
        # Newer news has put it off.
        self.next_detection_us = self._next_due_us(now_us)
        return False

    def _next_due_us(self, now_us: int) -> int:
        """When a judgement, or what is told of others, may differ from the present one."""
        judged, extra_us = self.neighbourhood.judged, self._health.extra_us
        due_us = self._detector.next_due_us(judged, extra_us, now_us)
        return min([due_us, *(at_us for at_us in self._ends_us() if at_us > now_us)])

    def _ends_us(self) -> Iterator[int]:
        """When this robot stops telling of deaths, checking robots, and being so patient."""
        told_us, checks_us = self._told_dead_until_us.values(), self._neighbourhood.checks_end_us
        return chain(told_us, checks_us, self._health.better_at_us)

    def detect_failures(self, now_us: int) -> list[tuple[str, State, State]]:
        """Suspect silent robots, declare suspects dead; (robot, before, after) of each change."""
        if not self.needs_detection(now_us):
            return []
        peers, around, detector = self.peers, self.neighbourhood, self._detector
        around.end_checks(now_us)
        for robot in [r for r, until_us in self._told_dead_until_us.items() if now_us >= until_us]:
            del self._told_dead_until_us[robot]
        before: dict[str, State] = {}
        for robot in detector.find_suspects(around.judged, self._token_lost, peers, now_us):
            before[robot] = peers[robot].state
            self._set(robot, peers[robot], State.SUSPECT)
        around = self.neighbourhood  # without those that are suspected from now on
        self._health.recover(now_us)
        accused = self._suspected, self._accused
        for robot in detector.find_dead(around, *accused, peers, now_us - self._health.extra_us):
            peer = peers[robot]
            before.setdefault(robot, peer.state)
            if peer.is_judged and not around.is_complete:
                self._told_dead_until_us[robot] = now_us + self.timing.max_silence_us
                self.news_changes += not detector.is_told(peer, peers)
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
        if peer.state is state:
            return
        peer.state = state
        if state.is_suspected:
            self._suspected[robot] = peer
        else:
            self._suspected.pop(robot, None)
        self._note_change(robot, peer)

    def _note_change(self, robot: str, peer: Peer) -> None:
        """Who is alive may have changed by what is known of a robot."""
        self.member_changes += 1
        self._alive.note(robot, peer)
        self._neighbourhood.note_change(robot)

    # -- what is known ------------------------------------------------------------------------

    def members(self) -> dict[str, Incarnation]:
        """Joined robots that are not dead or gone, suspects included: the plan's alive set."""
        return dict(sorted(self._alive.joined.items()))

    @property
    def live_peer_count(self) -> int:
        """How many others there are, neither dead nor gone."""
        return len(self._alive.live)

    def states(self) -> Mapping[str, State]:
        """Robot -> state, sorted by id."""
        return {robot: self.peers[robot].state for robot in sorted(self.peers)}

    def all_report_plan(self, digest: bytes) -> bool:
        """Whether every robot in good standing reports this plan digest.

        One that is still joining for the first time reports none, so it is waited for too.
        """
        for peer in self.peers.values():
            report = peer.report
            if peer.state.is_healthy and not (report.has_joined and report.plan_digest == digest):
                return False
        return True

    @property
    def joined_count(self) -> int:
        """How many others the alive set has."""
        return len(self._alive.joined)

    @property
    def newcomers(self) -> Collection[str]:
        """The robots in good standing that have yet to join."""
        return self._alive.newcomers

    def all_report_result(self, result: int, digest: bytes | None = None) -> bool:
        """Whether every robot of the alive set that this one judges reports this mission status.

        And, unless it is None, this digest of its plan. Suspects included. A robot that has missed
        the end can hear of it from its neighbours, who stay until it has.
        """
        return all(
            peer.report.result == result and digest in (None, peer.report.plan_digest)
            for peer in self.neighbourhood.judged.values()
            if peer.report.has_joined
        )

    def members_digest(self, mine: Incarnation) -> bytes:
        """Over the alive set and this robot's incarnation: equal where they are."""
        return self._alive.digest(self.me, mine)

    # -- where others hold other robots for alive ---------------------------------------------

    def view(self, mine: SelfReport) -> dict[str, SelfReport]:
        """The newest self-reports of the robots in good standing, and this robot's own."""
        reports = {r: peer.report for r, peer in self.peers.items() if peer.state.is_healthy}
        return dict(sorted((reports | {self.me: mine}).items()))

    def compare_view(self, source: str, reports: Mapping[str, SelfReport], now_us: int) -> None:
        """A robot tells whom it holds for alive: hear those oneself of whom it says otherwise."""
        self._now_us = now_us
        for robot, report in reports.items():
            known = self.peers.get(robot)
            if robot == self.me or (known is not None and report.incarnation < known.incarnation):
                continue
            self._take_report(robot, report, now_us, None)
            peer = self.peers[robot]
            if peer is not known or peer.state.is_suspected:
                self._neighbourhood.check(robot, now_us)
        for robot, peer in sorted(self.peers.items()):
            if peer.state.is_healthy and robot not in reports and robot != source:
                self._neighbourhood.check(robot, now_us)
        self.next_detection_us = now_us

    # -- what this robot tells others ---------------------------------------------------------

    def relays(self) -> dict[str, SelfReport]:
        """The relays that this robot's next heartbeat carries, sorted by robot."""
        return {
            robot: peer.report
            for robot, peer in sorted(self.neighbourhood.judged.items())
            if peer.state.is_healthy
        }

    def suspicions(self) -> tuple[Suspicion, ...]:
        """The suspicions that this robot's next heartbeat carries, sorted by robot."""
        if not self._suspected:
            return ()
        suspected = sorted(self._suspected.items())
        if not self.neighbourhood.is_complete:
            told = self._told_dead_until_us
            named = [(robot, peer) for robot, peer in suspected if peer.is_judged or robot in told]
            suspected = named[:MAX_SUSPICIONS]
        return tuple(
            Suspicion(
                robot,
                peer.incarnation,
                is_token_lost=peer.is_token_lost,
                is_dead=peer.state is State.DEAD,
                is_probe=peer.is_probed,
            )
            for robot, peer in suspected
        )

    @property
    def is_probing(self) -> bool:
        """Whether a robot that is not given up has been silent for too long."""
        suspected = self._suspected
        return bool(suspected) and any(peer.is_probed for peer in suspected.values())

    def can_answer_probe(self, heartbeat: Heartbeat, mine: Incarnation) -> bool:
        """Whether the sender probes a robot of which this one has news: another one, or itself."""
        for suspicion in heartbeat.suspicions:
            if suspicion.is_probe:
                peer = self.peers.get(suspicion.robot)
                is_me = suspicion.robot == self.me and suspicion.incarnation == mine
                if is_me or (
                    peer is not None
                    and peer.state.is_healthy
                    and peer.incarnation == suspicion.incarnation
                ):
                    return True
        return False
