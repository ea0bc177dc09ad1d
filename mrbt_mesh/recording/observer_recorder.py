"""Records an observer: what whoever watches has heard of the team."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.membership.peer import Peer, State
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.formats.mission_map import place_states, told_places
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.encoding import MessageSink
from mrbt_mesh.recording.fact_log import FactLog
from mrbt_mesh.recording.packing import (
    pack_alive,
    pack_beat,
    pack_nodes,
    pack_plan,
    pack_statuses,
    status_name,
)
from mrbt_mesh.recording.scene import TeamScene


class ObserverRecorder:
    """Call `update` after each `Observer.update`, and `message` with what arrives.

    An observer's plan is made within its update, after all facts that it has taken in.
    """

    def __init__(self, writer: MessageSink, observer: Observer, *, beats: bool = False) -> None:
        self._writer = writer
        self._observer = observer
        self._beats = beats
        self._facts = FactLog(observer.facts.map)
        self._plan: Plan | None = None
        self._plans = 0
        self._alive: dict[str, str] = {}
        self._nodes = ""
        self._robots: dict[str, tuple[Any, ...]] = {}
        self._trees: dict[str, bytes] = {}
        self._scene = TeamScene(observer.mission, writer.epoch_ns)
        self._told_places = told_places(observer.mission)
        self._places_from: tuple[int, Plan | None] = (-1, None)

    def message(self, kind: MessageKind, source: str, data: bytes, now_us: int) -> None:
        """A message has arrived. Raises OSError."""
        if self._beats and kind is MessageKind.HEARTBEAT:
            self._writer.write(channels.BEATS, now_us, pack_beat(source, data, False))

    def update(self, now_us: int) -> None:
        """Write what has changed. Raises OSError."""
        observer, writer = self._observer, self._writer
        for robot, peer in sorted(observer.membership.peers.items()):
            self._tree(robot, peer, now_us)
            self._robot(robot, peer, now_us)
            self._scene.see(robot, peer.state, peer.position)
        plan = observer.plan
        if plan is not None and plan is not self._plan:
            self._plan = plan
            self._plans += 1
            alive, digest = observer.membership.members(), observer.facts.map.digest()
            packed = pack_alive(alive)
            if packed != self._alive:
                self._alive = packed
                self._facts.add(channels.ALIVE, {"robots": packed})
            said = pack_plan(plan, self._plans, self._facts.number, digest, alive)
            self._facts.add(channels.PLANS, said)
            nodes = pack_nodes(plan)
            if nodes != self._nodes:
                self._nodes = nodes
                self._facts.add(channels.STATUSES, {"plan": self._plans, "nodes": nodes})
        for topic, data in self._facts.take():
            writer.write(topic, now_us, data)
        self._look_at_places()
        for topic, data in self._scene.take(now_us):
            writer.write(topic, now_us, data)
        writer.flush()

    def _look_at_places(self) -> None:
        observer = self._observer
        causes = (observer.facts.changes, observer.plan)
        if causes[0] != self._places_from[0] or causes[1] is not self._places_from[1]:
            self._places_from = causes
            tasks = observer.record.task_log
            states = place_states(self._told_places, observer.facts, tasks.has_succeeded)
            self._scene.see_places(states)

    def abandon(self) -> None:
        """Leave the recording as it is: it could not be written."""
        self._writer.abandon()

    def close(self) -> None:
        """End the recording. Raises OSError."""
        self._writer.close()

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
        self._writer.write(channels.ROBOTS, now_us, said)

    def _tree(self, robot: str, peer: Peer, now_us: int) -> None:
        statuses = peer.heartbeat.tree_statuses if peer.heartbeat is not None else b""
        if statuses != self._trees.get(robot, b""):
            self._trees[robot] = statuses
            said = {"robot": robot, "nodes": pack_statuses(statuses)}
            self._writer.write(channels.ROBOT_TREES, now_us, said)

    def _fault(self, robot: str, peer: Peer, before: tuple[Any, ...] | None, now_us: int) -> None:
        if before is None and peer.state is State.ALIVE:
            return  # it has just been heard for the first time
        said = {"event": str(peer.state), "robot": robot, "incarnation": str(peer.incarnation)}
        self._writer.write(channels.FAULTS, now_us, said)
