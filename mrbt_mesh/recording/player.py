"""Plays a recording: the state of its owner at any time, and the team as an observer sees it.

The observer receives the recording's messages as it would receive live ones.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NoReturn

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.engine import FASTEST, Engine
from mrbt_mesh.core.facts.records import IN_ANY_MISSION
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.membership.peer import ArrivalHistory, Peer, State
from mrbt_mesh.core.membership.timing import NEVER_US
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import read_incarnation, unpack_death
from mrbt_mesh.recording.reader import RecordedMessage, Recording, RecordingError
from mrbt_mesh.recording.recorded_state import RecordedState

_NO_DIGEST = bytes(8)
# How many records are replayed before a distant moment: about a second of work.
PLAYED_RECORDS = 2_000


class Player:
    """Plays a recording to any time. `state` and `observer` are as they were at `now_us`.

    `now_us` is the time of the recording. A torn end, as left by a power cut, is the last entry of
    the observer's timeline. Raises RecordingError if the recording was changed: see `mrbt recording
    verify`.
    """

    def __init__(
        self,
        recording: Recording,
        make_observer: Callable[[Mission], Observer] | None = None,
        engine: Engine = FASTEST,
        known_until_us: int | None = None,
    ) -> None:
        """`make_observer` makes the observer from the recording's first mission.

        By default it is a new observer. `known_until_us`: the observer has received another
        recording of the run until then, and gets only the rest of this one. None: it knows nothing
        yet.
        """
        self.recording = recording
        self._known_until_us = known_until_us
        self._engine = engine
        self._make_observer = make_observer or self._new_observer
        if recording.damage:
            first = recording.damage[0]
            self._refuse(f"record {first.number}: {first.text}")
        try:
            self.mission = recording.metadata.read_mission(str(recording.path))
        except ValueError as error:
            self._refuse(str(error))
        self._times_us = recording.records.times_us
        self._rewind()

    def _refuse(self, text: str) -> NoReturn:
        raise RecordingError(f"{self.recording.path}: {text}: see `mrbt recording verify`")

    def _new_observer(self, mission: Mission) -> Observer:
        metadata = self.recording.metadata
        timing = metadata.timing
        observer = Observer(mission, metadata.run, timing, default_solver, self._engine)
        observer.speed = metadata.speed
        return observer

    def _rewind(self) -> None:
        self.observer = self._make_observer(self.mission)
        # The owner of a second recording knew different things at each moment.
        is_second = self._known_until_us is not None
        known = self._new_observer(self.mission) if is_second else self.observer
        self.state = RecordedState(known.facts, self.recording.metadata.part)
        self._is_known = self._known_until_us is not None
        self._plan = self._engine.plan_making(default_solver)
        # Incarnation -> since when it has been missed: the best estimate of its death.
        self._missed_us: dict[tuple[str, Incarnation], int] = {}
        self._next = 0
        self.now_us = self.begin_us

    @property
    def begin_us(self) -> int:
        """The time at which the recording begins."""
        return self.recording.begin_us

    @property
    def end_us(self) -> int:
        """The time of the last record."""
        return max(self._times_us, default=0)

    def seek(self, at_us: int) -> None:
        """Go to a time of the recording, forwards or backwards."""
        for _ in self.play_to(at_us):
            pass

    def play_to(self, at_us: int, skips: bool = False) -> Iterator[None]:
        """Play to a time, record by record: the caller can inspect the team after each, or stop.

        With `skips`, only the state is restored for what is more than `PLAYED_RECORDS` away. The
        observer then knows the past like one that began to watch only shortly before.
        """
        wanted = bisect_right(self._times_us, at_us)
        if skips and not self._next <= wanted <= self._next + 2 * PLAYED_RECORDS:
            self._skip_to(wanted - PLAYED_RECORDS)
        elif wanted < self._next:
            self._rewind()
        while self._next < wanted:
            self._play_one(self._next)
            yield
        self.now_us = at_us

    def _skip_to(self, wanted: int) -> None:
        """Restart at the last plan before a record, with the messages that are valid there."""
        records, started_us = self.recording.records, self.observer.record.started_us
        self._rewind()
        while wanted > 0 and records.topics[wanted] != channels.PLANS:
            wanted -= 1
        if wanted <= 0:
            return
        try:
            valid = records.valid_before(wanted)
        except ValueError as error:
            self._refuse(str(error))
        # A scene lists all robots, so it comes before their positions.
        scenes = [index for index in valid if records.topics[index] == channels.SCENE]
        record = self.observer.record
        record.watched_from(self.begin_us, None)
        self.state.is_skipping = True
        for index in (*scenes, *(index for index in valid if index not in scenes)):
            self._play_one(index)
        self.state.is_skipping = False
        # The last change may have been a dropped fact.
        self.state.changes = records[wanted].data["facts"]
        record.is_catching_up = False
        record.started_us = started_us
        self._next = wanted

    def _play_one(self, index: int) -> None:
        self._next = index + 1
        number = index + 1
        try:
            record = self.recording.records[index]
            number = record.number
            self._play(record)
        except ValueError as error:
            self._refuse(f"record {number}: {error}")
        self.now_us = record.at_us
        if self._next == len(self._times_us) and self.recording.torn:
            text = f"{self.recording.name}: {self.recording.torn}"
            self.observer.record.say(self.now_us, text)

    def _play(self, record: RecordedMessage) -> None:
        is_later = record.at_us > (self._known_until_us or 0)
        if self._is_known and is_later and not self.state.is_skipping:
            self._take_over(record.at_us)
        entry = self.state.apply(record)
        if not self._is_known:
            self._show(record, entry)
        elif record.topic == channels.FAULTS:
            self._missing(record.data, record.at_us)

    def _show(self, record: RecordedMessage, entry: Entry | None) -> None:
        """Pass a record, and its fact if any, to the observer."""
        at_us, data = record.at_us, record.data
        if entry is not None:
            if self._is_new(entry):
                self.observer.facts_changed([entry], at_us)
        elif record.topic == channels.ROBOTS:
            self._robot(data["robot"], data, at_us)
        elif record.topic == channels.ROBOT_TREES:
            self._tree_ticked(data["robot"])
        elif record.topic == channels.REVOKED:
            self.observer.facts.set_revoked(frozenset(data["robots"]))
        elif record.topic == channels.PLANS and not self.state.is_skipping:
            self._planned(data, at_us)
        elif record.topic == channels.PARTS and self.state.plan is not None:
            self._planned(self.state.plan, at_us)
        elif record.topic in (channels.STATUSES, channels.ACTIONS):
            self._myself(at_us)
        elif record.topic in (channels.SCENE, channels.POSITIONS):
            self._placed()
        elif record.topic == channels.FAULTS:
            self._fault(data, at_us)
        elif record.topic == channels.DEATHS:
            self._death(data, at_us)

    def _is_new(self, entry: Entry) -> bool:
        """Merge a fact into the observer's facts; return False if it had the fact already."""
        facts = self.observer.facts
        return facts is self.state.facts or bool(facts.map.merge([entry]))

    def _take_over(self, at_us: int) -> None:
        """Pass what the owner knows to the observer, at the end of the recording that it knew
        before.
        """
        self._is_known = False
        # Other facts may be valid only in a revision of the mission, so that comes first.
        known = sorted(self.state.facts.map, key=lambda each: each.parts[0] not in IN_ANY_MISSION)
        for entry in known:
            if self._is_new(entry):
                self.observer.facts_changed([entry], at_us)
        for robot, data in self.state.robots.items():
            self._robot(robot, data, at_us)
        self._myself(at_us)

    def _fault(self, data: Mapping[str, Any], at_us: int) -> None:
        self._missing(data, at_us)
        if data["event"] == "dead":
            incarnation = read_incarnation(data["incarnation"])
            self.observer.record.declared_dead(data["robot"], incarnation, at_us)

    def _death(self, data: Mapping[str, Any], at_us: int) -> None:
        robot, incarnation, times = unpack_death(data, at_us)
        known = self.observer.membership.peers.get(robot)
        if times.detected_us is not None and (known is None or known.incarnation < incarnation):
            # Others held it for dead before this observer had heard it.
            self.observer.record.declared_dead(robot, incarnation, at_us)
        self.observer.record.death_recorded(robot, incarnation, times)

    def _missing(self, data: Mapping[str, Any], at_us: int) -> None:
        life, event = (data["robot"], read_incarnation(data["incarnation"])), data["event"]
        if event in ("suspect", "token_lost"):
            self._missed_us.setdefault(life, at_us)
        elif event in ("alive", "token_shown"):
            self._missed_us.pop(life, None)

    def _planned(self, data: Mapping[str, Any], at_us: int) -> None:
        observer = self.observer
        plan = self._plan(self.state.facts, self.state.alive)
        if plan.digest.hex() != data["digest"]:
            raise ValueError("its plan does not follow from its facts")
        self._myself(at_us)
        observer.follow(plan, at_us, bool(self.state.alive))

    def summary(self) -> dict[str, Any]:
        """Return the summary of the run as far as it was played, as `mrbt up` prints it."""
        peers = self.observer.membership.peers.values()
        result = self.observer.result(anybody_lives=any(peer.state.is_member for peer in peers))
        return run_summary(self.observer, result, self.now_us)

    def _placed(self) -> None:
        """Update the robots' positions; a robot that has left stays at its last position."""
        for robot, peer in self.observer.membership.peers.items():
            if peer.state is not State.LEFT:
                peer.position = self.state.positions.get(robot)

    # -- the robots ---------------------------------------------------------------------------

    def _myself(self, at_us: int) -> None:
        """Show the robot that recorded as a member of the team."""
        me, state = self.recording.metadata.robot, self.state
        if not me or me not in state.alive:
            return
        said = state.statuses or {}
        data = {
            "incarnation": str(state.alive[me]),
            "state": "alive",
            "joined": True,
            "plan": state.plan["digest"] if state.plan is not None else "",
            "statuses": [said[name] for name in ("T_i", "T_A", "T_G", "T_Li") if name in said],
            "percent": state.percent,
        }
        self._robot(me, data, at_us)

    def _tree_ticked(self, robot: str) -> None:
        peer = self.observer.membership.peers.get(robot)
        if peer is not None and peer.heartbeat is not None:
            statuses = self.state.trees[robot]
            peer.heartbeat = replace(peer.heartbeat, tree_statuses=statuses)

    def _robot(self, robot: str, data: Mapping[str, Any], at_us: int) -> None:
        incarnation, state = read_incarnation(data["incarnation"]), State(data["state"])
        # A robot does not record what other robots report.
        own = self.state.plan["digest"] if self.state.plan is not None else ""
        digest = bytes.fromhex(data.get("plan", own))
        report = SelfReport(incarnation, 0, digest, data["joined"], int(Status.RUNNING))
        known = self.observer.membership.peers.get(robot)
        if known is None or known.incarnation != incarnation:
            timing = self.recording.metadata.timing
            history = ArrivalHistory.of_new_robot(timing)
            known = Peer(incarnation, report, at_us, history, NEVER_US, NEVER_US)
            known.position = self.state.positions.get(robot)
            self.observer.membership.peers[robot] = known
        if "statuses" in data:
            statuses = tuple(int(Status[name.upper()]) for name in data["statuses"])
            known.heartbeat = Heartbeat(
                *(report, False, _NO_DIGEST, statuses, data["percent"], (), {}),
                tree_statuses=self.state.trees.get(robot, b""),
            )
        before, known.state, known.report = known.state, state, report
        self.observer.membership.note_change(robot, known)
        if data["joined"]:
            self.observer.record.robot_seen(robot, incarnation, at_us)
        if before is not state:
            evidence_us = self._missed_us.get((robot, incarnation), at_us)
            self.observer.record.state(robot, state, evidence_us, at_us)
