"""The I/O shell around an agent: real clock, Zenoh, actions and log. It makes no decisions."""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import gc
import json
import os
import signal
import threading
import time
import traceback
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import anyio

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.agent.effects import (
    Ask,
    AskRouter,
    CancelAction,
    DeclareToken,
    Effect,
    FeatureEffect,
    Forget,
    Log,
    MakePlan,
    Persist,
    Publish,
    Reply,
    SearchSchedule,
    StartAction,
    Stop,
    UseMission,
)
from mrbt_mesh.core.agent.inputs import (
    Input,
    LeaveRequested,
    PlanMade,
    ProblemFound,
    RecordingReported,
    RecordingSigned,
    ScheduleFound,
    TimerFired,
    WallClockRead,
    together,
)
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.agent.wall_clock import READ_AGAIN_US
from mrbt_mesh.core.facts.records import ADDRESS, NOT_RECORDED
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.failure_reasons import one_line
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.planner_need import planner_problem
from mrbt_mesh.core.scheduling.problem import Schedule
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.actions import ActionRunner, ProgramEffect, RobotIdentity
from mrbt_mesh.runtime.address_watch import AddressWatch
from mrbt_mesh.runtime.blocked_loop import loop_watchdog
from mrbt_mesh.runtime.context import RobotContext
from mrbt_mesh.runtime.fencing import FencingSelector, boottime_us, fenced
from mrbt_mesh.runtime.flood_gate import FloodGate
from mrbt_mesh.runtime.inbox import Inbox
from mrbt_mesh.runtime.journal import Journal
from mrbt_mesh.runtime.journal_writer import JournalWriter
from mrbt_mesh.runtime.launcher_lock import LauncherWatch
from mrbt_mesh.runtime.limited_file import append
from mrbt_mesh.runtime.link_watch import LinkWatch, Sighting
from mrbt_mesh.runtime.log import robot_logger
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.recording import robot_recording
from mrbt_mesh.runtime.robot_loop import RobotLoop
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError
from mrbt_mesh.runtime.session_config import TransportConfig, TransportError, require_threads
from mrbt_mesh.runtime.threads import note_threads
from mrbt_mesh.runtime.token_holders import life_of
from mrbt_mesh.runtime.zenoh_transport import ZenohTransport

if TYPE_CHECKING:
    from mrbt_mesh.plugins import RobotMeter
    from mrbt_mesh.runtime.key_folder import ManifestWatch

EVENTS_FILE = "events.jsonl"
CLOSE_TIMEOUT_S = 1.0
LEAVE_TIMEOUT_S = 3.0
WATCH_S = 0.25
LOOKS_PER_LEASE = 8
# The timeout for an answer, as a multiple of the pause before the next question.
LATE_ANSWERS = 4
REOPEN_RETRY_S = 0.1
# How long a search runs before it pauses, and the pause.
SEARCH_S, SEARCH_PAUSE_S = 0.001, 0.0005
# The longest that received inputs wait to be processed together.
MAX_SPACING_US = 20_000
# A link is silent after this many missed beats, but never before its lease would have expired.
SILENT_BEATS = 5
# Exit status of a robot stopped by a bug of its own: EX_SOFTWARE of sysexits.h.
BROKEN = 70


class BrokenRobotError(RuntimeError):
    """The robot's own code, not its program, has raised: a bug. The robot has stopped."""


@dataclass(frozen=True)
class RobotSetup:
    """The parts of a robot's process. Without a run directory it keeps no journal and no events.

    `meter` counts inputs and effects, and serves the counts. `log` is an object with a method per
    level; None means the robot's own log. `is_guest` is true if the robot lives inside another
    program, which owns the process, its signals and its memory.
    """

    mission: Mission
    config: AgentConfig
    options: RobotOptions
    transport: TransportConfig
    program: RobotProgram
    journal: Journal | None = None
    manifest: ManifestWatch | None = None
    meter: RobotMeter | None = None
    log: Any = None
    is_guest: bool = False


def make_known_to_anyio() -> None:
    """Let anyio find the event loop in callbacks scheduled by this task or by tasks that it starts.

    If sniffio is installed, anyio asks it, and sniffio recognizes only tasks: a callback could
    neither start a task nor open a cancel scope. `anyio.run` sets this variable too.
    """
    with contextlib.suppress(ImportError):
        import sniffio

        sniffio.current_async_library_cvar.set("asyncio")


class Driver:
    """Runs one agent until it stops. Implements `actions.Host`.

    `on_step` is called after each input, and at the end.
    """

    def __init__(self, setup: RobotSetup) -> None:
        self._setup = setup
        self._config = setup.config
        self._logger = setup.log or robot_logger(setup.config.robot)
        self.on_step: Callable[[], None] = lambda: None
        self._agent = Agent(setup.mission, setup.config, boottime_us())
        # The journal may hold a revision of the mission.
        in_force = self._agent.view.facts.in_force
        if problem := planner_problem(in_force, setup.config.lacks_planner):
            raise InputError(problem)
        self._meter = setup.meter
        self._journal = JournalWriter(
            setup.journal,
            lambda news: self._from_thread(self._submit, news),
            setup.config.journal_problem,
            self._meter.sync_s if self._meter else None,
        )
        self._recording = robot_recording(
            setup.options, setup.mission, setup.config, self._agent.view, self._recording_ended
        )
        self._run_dir = RunDir(setup.options.run_dir) if setup.options.run_dir else None
        # When the timer fires, on `boottime_us`.
        self._timer: asyncio.TimerHandle | None = None
        self._timer_us = 0
        self._stop: Stop | None = None
        self._broken: Exception | None = None
        # The context variables of the robot's tasks, once they run.
        self._context = contextvars.copy_context()
        self._is_ready = False
        # Times of the agent's last input, and of the last processing of received inputs.
        self._last_us = self._drained_us = 0
        # The wall clock minus `boottime_us`, as last given to the agent; only in missions with
        # jobs.
        self._wall_clock_offset_us: int | None = None
        # Set once the robot hears its team.
        self.begun = asyncio.Event()

    @property
    def view(self) -> AgentView:
        """A read-only view of the agent."""
        return self._agent.view

    @property
    def stop(self) -> Stop | None:
        """Why the robot has stopped; None while it runs."""
        return self._stop

    def context(self) -> RobotContext:
        """Return the context that the program's background functions receive."""
        return self._runner.robot_context()

    def run(self, launcher: LauncherWatch | None = None) -> Stop:
        """Run until the agent stops, or until its `launcher` has ended: then the robot leaves.

        Raises TransportError if the session cannot be opened, InputError if metrics cannot be
        served, and BrokenRobotError. The session is closed in the background at the end: end the
        process with `os._exit`.
        """
        selector = FencingSelector(self._config.timing.fence_us)
        selector.on_gap = self._after_gap
        options = {"loop_factory": lambda: RobotLoop(selector)}
        return anyio.run(self._main, launcher, selector, backend_options=options)

    async def run_as_guest(self) -> Stop:
        """Run in another program's event loop, until the agent stops or the task is cancelled.

        Raises TransportError if the session cannot be opened, InputError in a loop in which a robot
        cannot fence itself off, and BrokenRobotError.
        """
        loop, limit_us = asyncio.get_running_loop(), self._config.timing.fence_us
        note_threads(loop)
        with fenced(loop, limit_us, self._after_gap) as selector:
            return await self._live(None, selector)

    def _after_gap(self) -> None:
        """Wake the agent after the process was suspended, unless the robot is not ready yet."""
        if self._is_ready:
            self._call(self._submit, TimerFired())

    async def _main(self, launcher: LauncherWatch | None, selector: FencingSelector) -> Stop:
        with contextlib.ExitStack() as stack:
            if self._meter is not None:
                stack.enter_context(self._meter.serving(self._agent.view))
            return await self._live(launcher, selector)

    async def _live(self, launcher: LauncherWatch | None, selector: FencingSelector) -> Stop:
        self._stopped = anyio.Event()
        self._loop = asyncio.get_running_loop()
        make_known_to_anyio()
        self._context = contextvars.copy_context()
        setup, config, transport = self._setup, self._config, self._setup.transport
        self._inbox = inbox = Inbox(
            self._loop, lambda: self._call(self._wake, inbox, gate), are_beats_quiet=True
        )
        is_shared = bool(transport.routers)
        self._gate = gate = FloodGate(config.keys, config.run, inbox.put, is_link_shared=is_shared)
        lives = life_of(lambda: self._agent.view.peers, config.keys)
        self._transport = ZenohTransport(transport, gate.deliver, lives)
        await anyio.to_thread.run_sync(self._transport.open)
        try:
            async with anyio.create_task_group() as group:
                self._group = group
                own, speed = tuple(sorted(config.capabilities)), setup.options.speed
                identity = RobotIdentity(config.robot, config.type, os.getpid(), speed, own)
                self._runner = ActionRunner(group, setup.program, setup.mission, identity, self)
                self._runner.start_background()
                for task in (self._watch_links, self._look_regularly):
                    group.start_soon(self._guarded_task, task)
                if not setup.is_guest:
                    group.start_soon(self._guarded_task, self._watch_signals)
                self._is_ready = True
                if self._recording is not None and self._recording.why_not_begun:
                    self._recording_ended(self._recording.why_not_begun)
                self._journal.start()
                self.begun.set()
                self.submit(TimerFired())
                self._guarded(self._drain, inbox, gate)
                if launcher is not None:
                    launcher.call_when_gone(lambda: self._from_thread(self._lose_launcher))
                try:
                    with loop_watchdog(self, config, self._run_dir, selector.step):
                        await self._stopped.wait()
                finally:
                    # A task of the group may have raised: the robot is silent from now on, even
                    # while its program is still being stopped.
                    self._is_ready = False
                    self._loop.call_later(LEAVE_TIMEOUT_S, self._runner.abandon)
                group.cancel_scope.cancel()
        except Exception as error:
            self._break(error)
        finally:
            if self._timer is not None:
                self._timer.cancel()
            await self._close_journal()
            if self._recording is not None:
                self._recording.close()
            self._transport.close(CLOSE_TIMEOUT_S)
        if self._stop is None:
            self._carry_out(Stop(1, "its program cancelled the robot's own tasks"))
        assert self._stop is not None
        if self._broken is not None:
            raise BrokenRobotError(self._stop.reason) from self._broken
        return self._stop

    async def _close_journal(self) -> None:
        with anyio.CancelScope(shield=True):
            lost = await anyio.to_thread.run_sync(self._journal.close)
        if lost:
            self.log("error", "journal_not_written", entries=lost)

    # -- inputs ---------------------------------------------------------------------------

    def submit(self, event: Input) -> None:
        """Pass an input to the agent and carry out the effects that it returns.

        Inputs are ignored until everything that effects need has been started.
        """
        self._guarded(self._submit, event)

    def _call(self, call: Callable[..., None], *arguments: Any) -> None:
        """Like `_guarded`, for calls that do not come from the robot's own tasks and timers."""
        self._context.run(self._guarded, call, *arguments)

    def _guarded(self, call: Callable[..., None], *arguments: Any) -> None:
        """Run a callback of the event loop or of the program; if it raises, the robot stops.

        The event loop would only log the exception, after half a step.
        """
        if self._broken is None:
            try:
                call(*arguments)
            except Exception as error:
                self._break(error)

    async def _guarded_task(self, task: Callable[..., Awaitable[None]], *arguments: Any) -> None:
        """Like `_guarded`, for a task.

        The robot falls silent at once, before its tasks are cancelled.
        """
        try:
            await task(*arguments)
        except Exception as error:
            self._break(error)

    def _break(self, error: Exception) -> None:
        """Stop as if killed: send nothing more, hand nothing over, and let the other robots take
        over.
        """
        if self._broken is not None:
            return
        while isinstance(error, ExceptionGroup):
            error = error.exceptions[0]
        self._broken = error
        last = traceback.extract_tb(error.__traceback__)[-1:]
        where = "".join(f" ({os.path.basename(at.filename)}:{at.lineno})" for at in last)
        reason = one_line(f"broke, a bug of mrbt: {type(error).__name__}: {error}{where}")
        self._stop = Stop(BROKEN, reason)
        self._stopped.set()
        with contextlib.suppress(Exception):  # the log may be what has raised
            details = "".join(traceback.format_exception(error))
            self.log("error", "stopped", code=BROKEN, reason=reason, error=details)
        if self._run_dir is not None:
            self._run_dir.write_last_words(self._config.robot, reason)

    def _submit(self, event: Input) -> None:
        self._take_quiet_beats()
        self._step(event, boottime_us())
        self._set_timer()

    def _take_quiet_beats(self) -> None:
        """Process heartbeats that carry no news."""
        if self._is_ready:
            for events in together(self._inbox.take_quiet(self._last_us)):
                self._step(events, boottime_us())

    def _step(self, event: Input, now_us: int) -> None:
        if self._stop is not None or not self._is_ready:
            return
        if self._agent.view.reads_wall_clock:
            self._read_wall_clock(now_us)
        self._last_us = now_us
        if self._meter is not None:
            self._meter.take(event)
        effects = self._agent.handle(event, now_us)
        if self._recording is not None:
            # Recorded before anything is sent, so it survives a crash of this process.
            self._recording.do(lambda recorder: recorder.step(event, effects, now_us))
        for effect in effects:
            if self._meter is not None:
                self._meter.carry_out(effect)
            self._carry_out(effect)
        recorder = self._recording.recorder if self._recording is not None else None
        head = recorder.take_head() if recorder is not None else None
        if head is not None:
            self._step(RecordingSigned(head), now_us)
        self._inbox.are_beats_quiet = self._agent.view.is_calm
        self._runner.gate.look()
        self.on_step()

    def _recording_ended(self, reason: str) -> None:
        self.log("error", "recording_ended", reason=reason)
        # Called in the middle of a step, whose effects are still to be carried out.
        self._from_thread(self.submit, RecordingReported(f"{NOT_RECORDED}: {reason}"))

    def _read_wall_clock(self, now_us: int) -> None:
        """Give the agent the wall clock once, and again whenever it has been set."""
        offset_us, before_us = time.time_ns() // 1_000 - boottime_us(), self._wall_clock_offset_us
        if before_us is None or abs(offset_us - before_us) >= READ_AGAIN_US:
            self._wall_clock_offset_us = offset_us
            self._step(WallClockRead(offset_us), now_us)

    def _from_thread(self, call: Callable[..., None], *arguments: Any) -> None:
        """Schedule a call in the event loop from another thread."""
        # The loop is closed if the process is about to end.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._call, call, *arguments)

    def _wake(self, inbox: Inbox, gate: FloodGate) -> None:
        """Process received inputs.

        In a large team, inputs that arrive shortly after one another are processed together.
        """
        spacing_us = min(MAX_SPACING_US, self._agent.view.spacing_us)
        wait_us = self._drained_us + spacing_us - boottime_us()
        if wait_us > 0:
            self._loop.call_later(wait_us / 1e6, self._guarded, self._drain, inbox, gate)
        else:
            self._drain(inbox, gate)

    def _drain(self, inbox: Inbox, gate: FloodGate) -> None:
        if not self._is_ready:
            return  # received inputs stay in the inbox until the robot is ready
        if inbox.dropped:
            self._logger.warning("inbox_overflow", dropped=inbox.dropped)
            if self._meter is not None:
                self._meter.dropped += inbox.dropped
            inbox.dropped = 0
        for event in together((*inbox.take(), *gate.take_refused())):
            self._submit(event)
        self._drained_us = boottime_us()

    def _set_timer(self) -> None:
        """Make sure that the timer fires in time. If it fires early, it is set again."""
        if self._stop is not None:
            return
        now_us = boottime_us()
        due_us = self._agent.next_deadline_us(now_us)
        if self._timer is not None:
            if now_us < self._timer_us <= due_us:
                return
            self._timer.cancel()
        self._timer_us = due_us
        wait_s = max(0, due_us - now_us) / 1e6
        self._timer = self._loop.call_later(wait_s, self._guarded, self._fire)

    def _fire(self) -> None:
        self._timer = None
        now_us = boottime_us()
        if self._agent.next_deadline_us(now_us) <= now_us:
            self._submit(TimerFired())
        else:
            self._set_timer()

    async def _watch_signals(self) -> None:
        with anyio.open_signal_receiver(signal.SIGTERM, signal.SIGINT) as signals:
            async for _ in signals:
                await self.leave()

    def _lose_launcher(self) -> None:
        if self._stop is None:
            self.log("warning", "launcher_gone")
            self._group.start_soon(self._guarded_task, self.leave)

    async def leave(self) -> None:
        """Hand over the work and stop, within `LEAVE_TIMEOUT_S`."""
        self.submit(LeaveRequested())
        with anyio.move_on_after(LEAVE_TIMEOUT_S):
            await self._stopped.wait()
        self._carry_out(Stop(0, "left without waiting for its action to stop"))

    async def _look_regularly(self) -> None:
        """Periodically mark the robot alive, measure the loop's lag, process quiet heartbeats, and
        apply changes of the manifest.
        """
        while True:
            if self._run_dir is not None:
                self._run_dir.mark_alive(self._config.robot)
            due_s = self._loop.time() + WATCH_S
            await asyncio.sleep(WATCH_S)
            if self._meter is not None:
                self._meter.look(self._loop.time() - due_s, self._agent.view.agrees())
            self._take_quiet_beats()
            self._set_timer()
            manifest = self._setup.manifest
            if manifest is None or not manifest.look():
                continue
            if manifest.problem:
                self.log("error", "manifest_refused", reason=manifest.problem)
            elif manifest.is_revoked:
                self._carry_out(Stop(2, "its key has been revoked or replaced"))
            else:
                self.log("info", "manifest_taken_over")

    async def _watch_links(self) -> None:
        """Log links that fall silent or recover, and reopen a split session."""
        lease_us = self._setup.transport.lease_ms * 1_000
        watch = LinkWatch(max(lease_us, SILENT_BEATS * self._config.timing.heartbeat_us))
        addresses, problem, looks = AddressWatch(self._setup.transport), "", 0
        while True:
            await anyio.sleep(lease_us / LOOKS_PER_LEASE / MICRO)
            now_us = boottime_us()
            before, problem = problem, addresses.look()
            if problem != before:
                level, text = ("error", problem) if problem else ("info", "the address is back")
                self.log(level, "address_changed", reason=text)
                self.submit(ProblemFound(ADDRESS, problem))
            looks += 1
            if looks % LOOKS_PER_LEASE == 0 and not self._agent.view.peers:
                await self._require_threads()
            self._transport.follow_router()
            await anyio.to_thread.run_sync(self._transport.follow_tokens, abandon_on_cancel=True)
            linked = self._transport.linked()
            links = {
                robot: Sighting(
                    self._transport.heard_us(robot), peer.last_heard_us, robot in linked
                )
                for robot, peer in self._agent.view.peers.items()
                if peer.state is not State.LEFT and self._agent.view.judges(robot)
            }
            for event in watch.look(links, now_us):
                self.log("info", event.what, peer=event.robot, silent_s=event.silent_us / 1e6)
            rank = sorted([*links, self._config.robot]).index(self._config.robot)
            split = watch.split(links, rank, now_us)
            if split is not None:
                self.log("warning", "session_split", peer=split)
                await self._reopen()
                watch.reopened(boottime_us())

    async def _require_threads(self) -> None:
        """Stop if the process cannot start the threads of the session's first link: it would hear
        nothing.
        """
        try:
            await anyio.to_thread.run_sync(require_threads, abandon_on_cancel=True)
        except TransportError as error:
            self._carry_out(Stop(2, str(error)))

    async def _reopen(self) -> None:
        """Open a new session, retrying while the old one still holds its port."""
        reopen, problem = self._transport.reopen, ""
        while True:
            try:
                return await anyio.to_thread.run_sync(reopen, abandon_on_cancel=True)
            except TransportError as error:
                if str(error) != problem:
                    problem = str(error)
                    self.log("warning", "session_not_reopened", reason=problem)
            await anyio.sleep(REOPEN_RETRY_S)

    # -- effects --------------------------------------------------------------------------

    def _carry_out(self, effect: Effect) -> None:
        match effect:
            case StartAction() | CancelAction() | FeatureEffect() | UseMission():
                self._runner.carry_out(effect)
                self._save_revision(effect)
            case Publish(kind, data, to):
                self._transport.publish(kind, data, to)
            case Persist() | Forget():
                self._journal.carry_out(effect)
            case Ask(peer, data):
                # A late answer is as useful as any other.
                timeout_s = LATE_ANSWERS * self._config.timing.ask_timeout_us / 1e6
                self._transport.ask(peer, MessageKind.PULL, data, timeout_s)
            case AskRouter():
                self._transport.ask_router(effect)
            case Reply(query, pages):
                self._transport.reply(query, pages)
            case MakePlan():
                self._group.start_soon(self._guarded_task, self._make_plan, effect)
            case SearchSchedule():
                threading.Thread(target=self._search_schedule, args=(effect,), daemon=True).start()
            case DeclareToken(incarnation):
                self._transport.declare_token(incarnation)
            case Log(level, event, fields):
                self.log(level, event, **fields)
            case Stop() if self._stop is None:
                self._stop = effect
                level, code = "error" if effect.code else "info", effect.code
                self.log(level, "stopped", code=code, reason=effect.reason)
                self._stopped.set()

    def _save_revision(self, effect: ProgramEffect) -> None:
        """Save the revision in force for robots that are started from the run directory."""
        if isinstance(effect, UseMission) and self._run_dir is not None:
            try:
                self._run_dir.save_revision(effect.mission)
            except RunDirError as error:
                self.log("error", "revision_not_saved", reason=str(error))

    async def _make_plan(self, effect: MakePlan) -> None:
        try:
            plan = await anyio.to_thread.run_sync(effect.make, abandon_on_cancel=True)
        except Exception:
            # A robot that was fenced off meanwhile has changed its facts and no longer needs the
            # plan.
            if self._agent.view.awaited_plan == effect.number:
                raise
        else:
            if effect.number == 1 and not self._setup.is_guest:
                gc.freeze()  # as at the start, now including the team's facts
            self.submit(PlanMade(effect.number, plan))

    def _search_schedule(self, effect: SearchSchedule) -> None:
        # A busy thread holds the interpreter for up to 5 ms, and the loop would wait for it each
        # time.
        schedule: Schedule = ()
        begun_s = time.monotonic()
        try:
            for found in effect.steps:
                schedule = found.schedule
                if time.monotonic() - begun_s > SEARCH_S:
                    time.sleep(SEARCH_PAUSE_S)
                    begun_s = time.monotonic()
        except Exception as error:
            self._from_thread(partial(self.log, "error", "search_failed", reason=repr(error)))
        self._from_thread(self._submit, ScheduleFound(effect.number, schedule))

    # -- actions.Host ---------------------------------------------------------------------

    def take_news(self) -> None:
        if not self._inbox.is_empty:
            self._drain(self._inbox, self._gate)
            self._take_quiet_beats()

    def may_step(self) -> bool:
        until_us = self._agent.view.stepping.until_us()
        return until_us is None or boottime_us() < until_us

    def read_condition(self, name: str) -> bool:
        return self._agent.view.facts.condition_of(self._agent.view.robot, name)

    def read_value(self, name: str, job: str) -> Value | None:
        return self._agent.view.facts.entry(self._agent.view.robot, name, job)

    def record_event(self, event: Mapping[str, Any]) -> None:
        if self._run_dir is None:
            self.log("info", "physical_event", physical=dict(event))
            return
        line = json.dumps(dict(event), separators=(",", ":")) + "\n"
        path = self._run_dir.path / EVENTS_FILE
        try:
            append(path, line.encode(), self._setup.options.keep_bytes)
        except OSError as error:
            # The work has been done, so the log keeps a record of it if it can be written.
            reason = error.strerror or str(error)
            self.log("error", "event_not_written", reason=reason, physical=dict(event))

    def unix_time_s(self) -> float:
        return time.time()

    def log(self, level: str, event: str, **fields: Any) -> None:
        getattr(self._logger, level)(event, **fields)
