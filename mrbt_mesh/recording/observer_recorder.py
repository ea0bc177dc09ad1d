"""Records an observer: what it has heard of the team."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.formats.mission_map import place_states, told_places
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import (
    MessageSink,
    pack_beat,
    pack_nodes,
    pack_statuses,
    status_name,
)
from mrbt_mesh.recording.recorder import Recorder


class ObserverRecorder(Recorder):
    """Call `update` after each `Observer.update`, and `message` with what arrives.

    An observer's plan is made within its update, after all facts that it has taken in.
    """

    def __init__(self, sink: MessageSink, observer: Observer, *, beats: bool = False) -> None:
        super().__init__(sink, observer.mission, observer.facts.map)
        self._observer = observer
        self._beats = beats
        self._plan: Plan | None = None
        self._nodes = ""
        self._robots: dict[str, tuple[Any, ...]] = {}
        self._trees: dict[str, bytes] = {}
        self._map_places = told_places(observer.mission)
        self._places_from: tuple[int, Plan | None] = (-1, None)

    def message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        """A message has arrived. Raises OSError."""
        if self._beats and kind is MessageKind.HEARTBEAT:
            self._sink.write(channels.BEATS, now_us, pack_beat(source, data, False))

    def update(self, now_us: int) -> None:
        """Write what has changed. Raises OSError."""
        observer = self._observer
        for robot, peer in sorted(observer.membership.peers.items()):
            self._tree(robot, peer, now_us)
            self._robot(robot, peer, now_us)
            self._scene.see(robot, peer.state, peer.position)
        plan = observer.plan
        if plan is not None and plan is not self._plan:
            self._plan = plan
            self._add_plan(plan, observer.membership.members())
            nodes = pack_nodes(plan)
            if nodes != self._nodes:
                self._nodes = nodes
                self._add(channels.STATUSES, {"plan": self._plans, "nodes": nodes})
        self._write(self._noted(), now_us)
        self._look_at_places()
        self._write(self._scene.take(now_us), now_us)
        self._sink.flush()

    def _look_at_places(self) -> None:
        observer = self._observer
        causes = (observer.facts.changes, observer.plan)
        if causes[0] != self._places_from[0] or causes[1] is not self._places_from[1]:
            self._places_from = causes
            tasks = observer.record.task_log
            states = place_states(self._map_places, observer.facts, tasks.has_succeeded)
            self._scene.see_places(states)

    def _robot(self, robot: str, peer: Peer, now_us: int) -> None:
        beat, report = peer.heartbeat, peer.report
        statuses, percent = (beat.statuses, beat.progress) if beat is not None else ((), 0)
        said_itself = (report.has_joined, report.plan_digest, statuses, percent)
        known = (peer.incarnation, peer.state, *said_itself)
        before = self._robots.get(robot)
        if before == known:
            return
        self._robots[robot] = known
        incarnation = str(peer.incarnation)
        if before is None or before[:2] != known[:2]:
            self._fault(robot, peer, before, now_us)
        said: Mapping[str, Any] = {
            "robot": robot,
            "incarnation": incarnation,
            "state": str(peer.state),
            "joined": report.has_joined,
            "plan": report.plan_digest.hex(),
            "statuses": [status_name(status) for status in statuses],
            "percent": percent,
        }
        self._sink.write(channels.ROBOTS, now_us, said)

    def _tree(self, robot: str, peer: Peer, now_us: int) -> None:
        statuses = peer.heartbeat.tree_statuses if peer.heartbeat is not None else b""
        if statuses != self._trees.get(robot, b""):
            self._trees[robot] = statuses
            said = {"robot": robot, "nodes": pack_statuses(statuses)}
            self._sink.write(channels.ROBOT_TREES, now_us, said)

    def _fault(self, robot: str, peer: Peer, before: tuple[Any, ...] | None, now_us: int) -> None:
        if before is None and peer.state is State.ALIVE:
            return  # it has just been heard for the first time
        said = {"event": str(peer.state), "robot": robot, "incarnation": str(peer.incarnation)}
        self._sink.write(channels.FAULTS, now_us, said)
