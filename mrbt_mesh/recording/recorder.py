"""The common part of a robot's and an observer's recording: facts, plans, the scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from mrbt_mesh.core.facts.records import IN_ANY_MISSION
from mrbt_mesh.core.facts.store import Change, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.peer import Peer
from mrbt_mesh.core.membership.wire import RecordingHead
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.formats.mission_map import place_states, told_places
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import MessageSink, pack_alive, pack_fact, pack_head, pack_plan
from mrbt_mesh.recording.scene import TeamScene

TopicMessage: TypeAlias = tuple[str, Mapping[str, Any]]


class Recorder:
    """Keeps the changes of facts in order, and what happened between them.

    The facts that exist already come first. Messages for facts are created when they are written,
    because the proof of a batch is complete only at its end.
    """

    def __init__(self, sink: MessageSink, mission: Mission, facts: TeamFacts) -> None:
        self._sink = sink
        self._facts = facts
        self._use(mission)
        self._plans = 0
        self._alive: dict[str, Incarnation] = {}
        self._revoked: frozenset[str] = frozenset()
        self._heads: dict[str, RecordingHead] = {}
        self._changes = 0
        # Whether the last plan was computed from the current facts and alive set.
        self._is_settled = True
        # (topic, number of the change or 0, the fact or the message).
        self._waiting: list[tuple[str, int, Any]] = []
        # Missions come first, as in robots: other facts may be valid only in a revision.
        known = sorted(facts.map, key=lambda entry: entry.parts[0] not in IN_ANY_MISSION)
        self._facts_changed([(None, entry) for entry in known])
        facts.map.subscribe(self._facts_changed)

    def _use(self, mission: Mission) -> None:
        """Use a mission that is in force from now on."""
        self._mission = mission
        # The places of the map that conditions describe, and what their states were computed from.
        self._places = told_places(mission)
        self._places_from: tuple[object, ...] = ()
        self._scene = TeamScene(mission, self._sink.epoch_ns)

    def _facts_changed(self, changes: Sequence[Change]) -> None:
        if self._facts.in_force is not self._mission:
            self._use(self._facts.in_force)
        self._is_settled = False
        self._add_revoked()
        for old, new in changes:
            self._changes += 1
            topic = channels.DROPPED if new is None else channels.FACTS
            self._waiting.append((topic, self._changes, new or old))

    def _add(self, topic: str, data: Mapping[str, Any]) -> None:
        """Add a message between the changes of facts around it."""
        self._waiting.append((topic, 0, data))

    def _add_revoked(self) -> None:
        """Note whose facts were revoked, before what follows from that."""
        if self._facts.revoked != self._revoked:
            self._revoked = self._facts.revoked
            self._is_settled = False
            self._add(channels.REVOKED, {"robots": sorted(self._revoked)})

    def _add_alive(self, alive: Mapping[str, Incarnation]) -> None:
        """Note the alive set, if it has changed."""
        if alive != self._alive:
            self._alive = dict(alive)
            self._is_settled = False
            self._add(channels.ALIVE, {"robots": pack_alive(alive)})

    def _add_plan(self, plan: Plan, alive: Mapping[str, Incarnation]) -> None:
        """Note a plan, and the alive set that it was made for."""
        self._add_revoked()
        self._add_alive(alive)
        self._plans += 1
        digest = self._facts.map.digest()
        self._add(channels.PLANS, pack_plan(plan, self._plans, self._changes, digest, alive))
        self._is_settled = True

    def _begin_part(self, now_us: int, **about: Any) -> None:
        """Start another part if this one is full and the current state is complete."""
        if self._sink.is_full and self._is_settled and not self._waiting:
            said = {"incarnation": "", "sequence": 0, "ticket": 0, "changes": self._changes}
            self._sink.begin_part(self._mission, self._facts.map, {**said, **about}, now_us)

    def _noted(self) -> Iterator[TopicMessage]:
        """Yield what was noted; each message is returned once."""
        waiting, self._waiting = self._waiting, []
        for topic, number, what in waiting:
            if topic == channels.FACTS:
                yield topic, pack_fact(what, number)
            elif topic == channels.DROPPED:
                yield topic, {"number": number, "author": what.author, "name": what.name}
            else:
                yield topic, what

    def _write(self, messages: Iterable[TopicMessage], now_us: int) -> None:
        for topic, data in messages:
            self._sink.write(topic, now_us, data)

    def _write_scene(
        self, now_us: int, has_succeeded: Callable[[str], bool], *causes: object
    ) -> None:
        """Write the changes of robots and places. Places are computed only if other `causes` are
        given.
        """
        if self._places and causes != self._places_from:
            self._places_from = causes
            self._scene.see_places(place_states(self._places, self._facts, has_succeeded))
        self._write(self._scene.take(now_us), now_us)

    def _heard(self, robot: str, peer: Peer) -> Iterator[TopicMessage]:
        """Note how far another robot, which was heard, has signed its recording, if that has
        changed.
        """
        head = peer.heartbeat.recorded if peer.heartbeat is not None else None
        if head is not None and self._heads.get(robot) != head:
            self._heads[robot] = head
            yield channels.HEADS, pack_head(robot, peer.incarnation, head)

    def abandon(self) -> None:
        """Leave the recording as it is after a failed write."""
        self._sink.abandon()

    def close(self) -> None:
        """End the recording. Raises OSError."""
        self._sink.close()
