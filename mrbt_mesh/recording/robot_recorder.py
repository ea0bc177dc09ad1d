"""Records one agent: its inputs, plans and actions, in the order of its steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from mrbt_mesh.core.agent.effects import CancelAction, Effect, Log, Publish, StartAction, Stop
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    Input,
    InputBatch,
    MessageReceived,
    ProgressReported,
    TokenChanged,
)
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Outcome
from mrbt_mesh.core.facts.store import Change, Incarnation, Version
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.wire import MessageKind, RecordingHead
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.task_log import TaskLog
from mrbt_mesh.recording import channels
from mrbt_mesh.recording.messages import (
    STATUS_NAMES,
    pack_beat,
    pack_statuses,
)
from mrbt_mesh.recording.recorder import Recorder, TopicMessage
from mrbt_mesh.recording.writer import RecordingWriter

# Progress is recorded again once it has advanced by this many percent.
PERCENT_STEP = 10

_TREES = ("T_i", "T_A", "T_G", "T_Li")
_LIFE = ("joined", "fenced", "catches_up", "caught_up", "later_life_found", "leaving")
_STATES = tuple(f"robot_{state}" for state in State)


class RobotRecorder(Recorder):
    """Records an agent. Call `step` after each `Agent.handle`, before its effects are carried out.

    A robot records before it sends. `beats`: heartbeats are recorded as well.
    """

    def __init__(
        self, sink: RecordingWriter, view: AgentView, now_us: int, *, beats: bool = False
    ) -> None:
        self._tasks = TaskLog(view.facts.in_force)
        self._robot = view.robot
        # The version of the last of its own facts.
        self._version_written = Version(Incarnation(0, ""), 0)
        # Whether an action has ended whose outcome is still to be written, and whether one was
        # written in this step.
        self._awaits_outcome = self._has_outcome = False
        super().__init__(sink, view.facts.in_force, view.facts)
        self._writer, self._view = sink, view
        self._beats = beats
        self._is_alive_known = False
        self._version: tuple[int, int] = (-1, -1)
        self._robots: dict[str, tuple[Incarnation, State, bool]] = {}
        self._statuses: tuple[Any, ...] = ()
        self._nodes = ""
        self._tree = b""
        self._lost = view.lost
        self._action: StartAction | None = None
        self._percent = 0
        view.subscribe_to_plans(self._planned)
        self._write(self._noted(), now_us)
        sink.flush(now_us)

    def _use(self, mission: Mission) -> None:
        super()._use(mission)
        self._tasks.revised(mission)

    def _planned(self, plan: Plan, alive: Mapping[str, Incarnation]) -> None:
        self._add_plan(plan, alive)
        self._is_alive_known = False  # a plan that was made elsewhere is for those of before
        self._nodes = pack_statuses(plan.evaluation.declared_statuses(self._mission.tree))
        if self._places:
            self._tasks.plan(plan)

    def _facts_changed(self, changes: Sequence[Change]) -> None:
        super()._facts_changed(changes)
        for _, new in changes:
            if new is not None and self._places:
                self._tasks.fact(new)
            if new is not None and new.author == self._robot:
                self._version_written = max(self._version_written, new.version)
                self._has_outcome |= isinstance(new.record, Outcome)

    def take_head(self) -> RecordingHead | None:
        """Return how far the recording has been signed, once each time, for the other robots."""
        return self._writer.take_head()

    def step(self, event: Input, effects: Sequence[Effect], now_us: int) -> None:
        """Write what an input has changed, and the effects to be carried out. Raises OSError."""
        taken = event.inputs if isinstance(event, InputBatch) else (event,)
        for each in taken:
            self._write(self._inputs(each), now_us)
        view = self._view
        version = (view.version[1], view.suspicion_changes)
        if version != self._version:
            self._version = version
            self._write(self._changed_robots(), now_us)
            self._is_alive_known = False
        if not self._is_alive_known and not view.is_joining:
            self._is_alive_known = True
            self._add_alive(view.alive())
        self._write(self._noted(), now_us)
        statuses = (self._nodes, *view.statuses)
        if self._plans and statuses != self._statuses:
            self._statuses = statuses
            of_trees = {t: STATUS_NAMES[s] for t, s in zip(_TREES, view.statuses, strict=True)}
            said = {"plan": self._plans, "nodes": self._nodes, **of_trees}
            self._write([(channels.STATUSES, said)], now_us)
        if view.tree_statuses != self._tree:
            self._tree = view.tree_statuses
            said = {"robot": view.robot, "nodes": pack_statuses(self._tree)}
            self._write([(channels.ROBOT_TREES, said)], now_us)
        for effect in effects:
            self._write(self._effects(effect), now_us)
        # A plan follows a change of facts, if anything does.
        self._write_scene(now_us, self._tasks.has_succeeded, self._plans)
        self._awaits_outcome &= not self._has_outcome
        self._has_outcome = False
        if effects:
            # Inputs without effects need no flush.
            self._sink.flush(now_us)
            if not view.is_joining and not view.is_leaving and not self._awaits_outcome:
                life, written = view.incarnation, self._version_written
                sequence = written.sequence if written.incarnation == life else 0
                ticket = self._action.ticket if self._action is not None else 0
                self._begin_part(now_us, incarnation=str(life), sequence=sequence, ticket=ticket)

    # -- what came in -------------------------------------------------------------------------

    def _inputs(self, event: Input) -> Iterator[TopicMessage]:
        match event:
            case MessageReceived(MessageKind.HEARTBEAT, source, data):
                self._see(source)
                peer = self._view.peers.get(source)
                if peer is not None:
                    yield from self._heard(source, peer)
                if self._beats:
                    yield channels.BEATS, pack_beat(source, data, False)
            case TokenChanged(robot, incarnation, held):
                what = "token_shown" if held else "token_lost"
                yield _fault(what, robot, str(incarnation))
            case ProgressReported(ticket, percent) if abs(percent - self._percent) >= PERCENT_STEP:
                self._percent = percent
                yield from self._own("progress", ticket, percent=percent)
            case ActionFinished(ticket, success, _, error):
                ended = list(self._own("finished", ticket, success=success, error=error))
                if ended:
                    self._awaits_outcome = not (success and self._is_on_way)
                yield from ended
            case ActionStopped(ticket):
                yield from self._own("stopped", ticket)

    @property
    def _is_on_way(self) -> bool:
        return self._action is not None and bool(self._action.travel_to)

    def _own(self, event: str, ticket: int, **more: Any) -> Iterator[TopicMessage]:
        action = self._action
        if action is not None and action.ticket == ticket:
            yield channels.ACTIONS, {"event": event, **_of(action), **more}

    def _see(self, robot: str) -> None:
        """Update a robot's state and position in the scene."""
        peer = self._view.peers.get(robot)
        if peer is not None:
            self._scene.see(robot, peer.state, peer.position)

    def _capabilities(self) -> Iterator[TopicMessage]:
        before, after = self._lost, self._view.lost
        self._lost = after
        me = (self._view.robot, str(self._view.incarnation))
        for what, names in (
            ("capabilities_lost", [name for name in after if name not in before]),
            ("capabilities_restored", [name for name in before if name not in after]),
        ):
            if names:
                yield _fault(what, *me, capabilities=names)

    # -- what follows -------------------------------------------------------------------------

    def _changed_robots(self) -> Iterator[TopicMessage]:
        for robot, peer in sorted(self._view.peers.items()):
            self._see(robot)
            has_joined = peer.report.has_joined
            known = (peer.incarnation, peer.state, has_joined)
            if self._robots.get(robot) == known:
                continue
            self._robots[robot] = known
            yield (
                channels.ROBOTS,
                {
                    "robot": robot,
                    "incarnation": str(peer.incarnation),
                    "state": str(peer.state),
                    "joined": has_joined,
                },
            )

    def _effects(self, effect: Effect) -> Iterator[TopicMessage]:
        me = self._view.robot
        match effect:
            case StartAction():
                self._action, self._percent = effect, 0
                more = {
                    "coalition": effect.party,
                    "partners": list(effect.partners),
                    "performance": effect.performance / MICRO,
                }
                if effect.travel_to:
                    more["travel_to"] = effect.travel_to
                yield channels.ACTIONS, {"event": "started", **_of(effect), **more}
            case CancelAction(ticket):
                yield from self._own("cancelled", ticket)
            case Publish(MessageKind.HEARTBEAT, data):
                self._scene.see(me, State.ALIVE, self._view.position)
                if self._beats:
                    yield channels.BEATS, pack_beat(me, data, True)
            case Log(_, event, fields) if event in _STATES:
                robot = str(fields["robot"])
                incarnation = str(self._view.peers[robot].incarnation)
                yield _fault(event.removeprefix("robot_"), robot, incarnation)
            case Log(_, "capabilities_changed"):
                yield from self._capabilities()
            case Log(_, "grants_ran_out"):
                yield _fault("grants_ran_out", me, str(self._view.incarnation))
            case Log(_, event) if event in _LIFE:
                self._awaits_outcome = False  # it belongs to no life, or to the next one
                said = {"event": event, "incarnation": str(self._view.incarnation)}
                yield channels.LIFE, said
            case Stop(code, reason):
                said = {"event": "stopped", "incarnation": str(self._view.incarnation)}
                yield channels.LIFE, {**said, "code": code, "reason": reason}


def _of(action: StartAction) -> dict[str, Any]:
    names = ("ticket", "activation", "global_task", "local_task")
    return {name: getattr(action, name) for name in names}


def _fault(event: str, robot: str, incarnation: str, **more: Any) -> TopicMessage:
    return channels.FAULTS, {"event": event, "robot": robot, "incarnation": incarnation, **more}
