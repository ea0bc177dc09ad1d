"""Records an observer: everything that it hears of the team."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.episodes import DeathTimes
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import (
    STATUS_NAMES,
    MessageSink,
    pack_beat,
    pack_death,
    pack_statuses,
)
from mrbt_mesh.recording.recorder import Recorder


class ObserverRecorder(Recorder):
    """Call `update` after each `Observer.update`, and `message` with what arrives.

    An observer computes its plan within its update, after it has processed all facts.
    """

    def __init__(self, sink: MessageSink, observer: Observer, *, beats: bool = False) -> None:
        super().__init__(sink, observer.mission, observer.facts)
        self._observer = observer
        self._beats = beats
        self._plan: Plan | None = None
        self._nodes = ""
        self._robots: dict[str, tuple[Any, ...]] = {}
        self._trees: dict[str, bytes] = {}
        self._deaths: dict[int, DeathTimes] = {}

    def message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        """Record a message that has arrived. Raises OSError."""
        if self._beats and kind is MessageKind.HEARTBEAT:
            self._sink.write(channels.BEATS, now_us, pack_beat(source, data, False))

    def update(self, now_us: int) -> None:
        """Write what has changed. Raises OSError."""
        observer = self._observer
        for robot, peer in sorted(observer.membership.peers.items()):
            self._tree(robot, peer, now_us)
            self._robot(robot, peer, now_us)
            self._write(self._heard(robot, peer), now_us)
            self._scene.see(robot, peer.state, peer.position)
        self._write_deaths(now_us)
        plan = observer.plan
        if plan is not None and plan is not self._plan:
            self._plan = plan
            self._add_plan(plan, observer.membership.members())
            nodes = pack_statuses(plan.evaluation.declared_statuses(observer.mission.tree))
            if nodes != self._nodes:
                self._nodes = nodes
                self._add(channels.STATUSES, {"plan": self._plans, "nodes": nodes})
        self._write(self._noted(), now_us)
        has_succeeded = observer.record.task_log.has_succeeded
        self._write_scene(now_us, has_succeeded, observer.facts.changes, plan)
        self._sink.flush(now_us)
        self._begin_part(now_us)

    def _robot(self, robot: str, peer: Peer, now_us: int) -> None:
        beat, report = peer.heartbeat, peer.report
        statuses, percent = (beat.statuses, beat.progress) if beat is not None else ((), 0)
        reported = (report.has_joined, report.plan_digest, statuses, percent)
        known = (peer.incarnation, peer.state, *reported)
        before = self._robots.get(robot)
        if before == known:
            return
        self._robots[robot] = known
        # A robot that has just been heard for the first time has no fault.
        is_new = before is None and peer.state is State.ALIVE
        if not is_new and (before is None or before[:2] != known[:2]):
            fault = {"event": str(peer.state), "robot": robot, "incarnation": str(peer.incarnation)}
            self._sink.write(channels.FAULTS, now_us, fault)
        said: Mapping[str, Any] = {
            "robot": robot,
            "incarnation": str(peer.incarnation),
            "state": str(peer.state),
            "joined": report.has_joined,
            "plan": report.plan_digest.hex(),
            "statuses": [STATUS_NAMES[status] for status in statuses],
            "percent": percent,
        }
        self._sink.write(channels.ROBOTS, now_us, said)

    def _write_deaths(self, now_us: int) -> None:
        for index, fault in enumerate(self._observer.record.major):
            if not fault.is_older and self._deaths.get(index) != fault.times:
                self._deaths[index] = fault.times
                self._sink.write(channels.DEATHS, now_us, pack_death(fault, now_us))

    def _tree(self, robot: str, peer: Peer, now_us: int) -> None:
        statuses = peer.heartbeat.tree_statuses if peer.heartbeat is not None else b""
        if statuses != self._trees.get(robot, b""):
            self._trees[robot] = statuses
            said = {"robot": robot, "nodes": pack_statuses(statuses)}
            self._sink.write(channels.ROBOT_TREES, now_us, said)
