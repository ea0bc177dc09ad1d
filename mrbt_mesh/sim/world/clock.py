"""Virtual time: an event queue in integer microseconds, and an asyncio loop slaved to it.

Robots' actions are real async code, so they run on a real event loop. That loop never sleeps:
where it would wait for its next timer, it lets the simulation's own events happen instead, and
moves the clock. A run is deterministic as long as the actions themselves are: no threads, no
real clocks, no unseeded randomness.
"""

from __future__ import annotations

import asyncio
import contextvars
import heapq
import math
import selectors
from collections.abc import Callable
from contextvars import Context
from typing import TypeVarTuple

from mrbt_mesh.runtime.robot_loop import RobotLoop

MICRO = 1_000_000


_Ts = TypeVarTuple("_Ts")


class DeadlockError(RuntimeError):
    """Nothing can ever happen any more: no event is due and no task waits for a time."""


class VirtualClock:
    """The simulation's events, ordered by (time, order of scheduling), and the time, from 0."""

    def __init__(self) -> None:
        self.now_us = 0
        self.touched = False
        self.on_error: Callable[[Exception], None] | None = None
        self._sequence = 0
        self._events: list[tuple[int, int, Callable[[], None]]] = []
        self._failed = False

    def at(self, at_us: int, event: Callable[[], None]) -> None:
        """Let `event` happen at `at_us`, after all that is already due then; never in the past."""
        self._sequence += 1
        due_us = at_us if at_us > self.now_us else self.now_us
        heapq.heappush(self._events, (due_us, self._sequence, event))

    def advance(self, timeout_s: float | None) -> None:
        """Let up to `timeout_s` pass, less if an event touches the event loop; None: for ever.

        An error in an event goes to `on_error` once; after that no more events happen, so that
        the loop can shut down. Raises DeadlockError if nothing is left to wait for.
        """
        if timeout_s is not None and timeout_s <= 0:
            return
        end_us = None if timeout_s is None else self.now_us + max(1, round(timeout_s * MICRO))
        self.touched = False
        events = self._events
        while events and not self._failed and (end_us is None or events[0][0] <= end_us):
            self.now_us, _, event = heapq.heappop(events)
            try:
                event()
            except Exception as error:
                self._fail(error)
            if self.touched:
                return
        if end_us is None:
            self._fail(DeadlockError(f"nothing can happen any more after {self.now_us} us"))
            return
        self.now_us = end_us

    def _fail(self, error: Exception) -> None:
        first = not self._failed
        self._failed = True
        if not first or self.on_error is None:
            raise error
        self.on_error(error)


class LocalClock:
    """The clocks of one robot's computer, as Linux has them, in microseconds.

    `monotonic_us` times its waits and does not run while the computer is suspended;
    `boottime_us`, which agents go by, does not. Both may run fast or slow by `rate_ppm`, and the
    boot-time clock may jump ahead (a virtual machine that is resumed). It never goes back. All of
    them stand still while the machine is paused.

    `unix_us`, the wall clock, shows `launch_unix_us` at the begin of the simulation, and may be
    ahead of the true time or behind it, run fast or slow, and be set.
    """

    def __init__(self, clock: VirtualClock, launch_unix_us: int = 0) -> None:
        self._clock = clock
        self._launch_unix_us = launch_unix_us
        self._wall_set_us = self._wall_ahead_us = self._wall_drift_ppm = 0
        self._rate_ppm = 0
        self._since_us = 0
        self._monotonic_us = 0
        self._ahead_us = 0
        self._suspended_us: int | None = None
        self._is_paused = False

    @property
    def monotonic_us(self) -> int:
        if self._suspended_us is not None:
            return self._monotonic_us
        passed_us = self._clock.now_us - self._since_us
        if not self._rate_ppm:
            return self._monotonic_us + passed_us
        return self._monotonic_us + passed_us + passed_us * self._rate_ppm // MICRO

    @property
    def boottime_us(self) -> int:
        if self._suspended_us is None:
            if not self._rate_ppm:  # asked with every event, and nearly always so
                passed_us = self._clock.now_us - self._since_us
                return self._monotonic_us + passed_us + self._ahead_us
            return self.monotonic_us + self._ahead_us
        suspended_us = 0 if self._is_paused else self._clock.now_us - self._suspended_us
        return self.monotonic_us + self._ahead_us + suspended_us

    def when_us(self, monotonic_us: int) -> int:
        """The simulation's time when the monotonic clock will show at least `monotonic_us`."""
        wait_us = max(0, monotonic_us - self.monotonic_us)
        return self._clock.now_us - (-wait_us * MICRO // (MICRO + self._rate_ppm))

    def set_rate(self, rate_ppm: int) -> None:
        """Run this much faster (or slower, below 0) than the simulation's time from now on."""
        self._settle()
        self._rate_ppm = rate_ppm

    @property
    def unix_us(self) -> int:
        now_us = self._clock.now_us
        if self._is_paused and self._suspended_us is not None:
            now_us = self._suspended_us
        drift_us = (now_us - self._wall_set_us) * self._wall_drift_ppm // MICRO
        return self._launch_unix_us + now_us + self._wall_ahead_us + drift_us

    def set_wall_clock(self, ahead_us: int, drift_ppm: int) -> None:
        """Set the wall clock: so much ahead of the true time now, and drifting from it."""
        self._wall_set_us, self._wall_ahead_us = self._clock.now_us, ahead_us
        self._wall_drift_ppm = drift_ppm

    def jump(self, ahead_us: int) -> None:
        """Let the boot-time clock jump ahead."""
        self._ahead_us += ahead_us

    def suspend(self, is_paused: bool = False) -> None:
        """Stop the monotonic clock; of a machine that `is_paused`, the others too."""
        self._settle()
        self._suspended_us, self._is_paused = self._clock.now_us, is_paused

    def resume(self) -> None:
        """Let the clocks go on; after a suspend the boot-time clock knows how long it took."""
        if self._suspended_us is not None:
            stood_us = self._clock.now_us - self._suspended_us
            if self._is_paused:
                self._wall_ahead_us -= stood_us
            else:
                self._ahead_us += stood_us
            self._since_us = self._clock.now_us
            self._suspended_us, self._is_paused = None, False

    def _settle(self) -> None:
        if self._suspended_us is None:
            self._monotonic_us = self.monotonic_us
            self._since_us = self._clock.now_us


class Gate:
    """Holds back the timers of one robot's code while the robot does not run.

    Code belongs to the gate that `current_gate` shows in its context; tasks inherit it. `clock`
    is the robot's: its code's waits are timed by it. `ahead_us`: so much of its next waits is over
    already, since the work that it begins was under way before.
    """

    def __init__(self, clock: LocalClock) -> None:
        self.clock = clock
        self.is_closed = False
        self.ahead_us = 0
        self._held: list[Callable[[], None]] = []

    def waited(self, due_us: int) -> int:
        """When a wait ends that would end at `due_us` if all of it were still to come."""
        if not self.ahead_us:
            return due_us
        over_us = min(self.ahead_us, max(0, due_us - self.clock.monotonic_us))
        self.ahead_us -= over_us
        return due_us - over_us

    def close(self) -> None:
        self.is_closed = True

    def open(self) -> None:
        """Let all timers that came due meanwhile fire, in their order."""
        self.is_closed = False
        held, self._held = self._held, []
        for fire in held:
            fire()

    def hold(self, fire: Callable[[], None]) -> None:
        """Keep one timer for later."""
        self._held.append(fire)


current_gate: contextvars.ContextVar[Gate | None] = contextvars.ContextVar("gate", default=None)


class _VirtualSelector(selectors.SelectSelector):
    """Waits in virtual time only; what it is asked to watch (the loop's own pipe) never matters."""

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__()
        self._clock = clock

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._clock.advance(timeout)
        return []


class VirtualLoop(RobotLoop):
    """An asyncio event loop in virtual time.

    `time()` is the virtual clock in seconds, for a robot's code the monotonic clock of that robot.
    """

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(_VirtualSelector(clock))
        self._clock = clock
        # Timers are floats, the clock counts whole microseconds: due means due to the microsecond.
        self._clock_resolution = 1 / MICRO

    def time(self) -> float:
        gate = current_gate.get()
        return (self._clock.now_us if gate is None else gate.clock.monotonic_us) / MICRO

    def call_soon(
        self, callback: Callable[[*_Ts], object], *args: *_Ts, context: Context | None = None
    ) -> asyncio.Handle:
        self._clock.touched = True
        return super().call_soon(callback, *args, context=context)

    def call_at(
        self,
        when: float,
        callback: Callable[[*_Ts], object],
        *args: *_Ts,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        self._clock.touched = True
        gate = current_gate.get()
        # A loop that waits for a part of a microsecond and then reads `time` would never end.
        now_s = self.time()
        if now_s < when < now_s + 1 / MICRO:
            when = now_s + 1 / MICRO
        if gate is None or when == math.inf:
            return super().call_at(when, callback, *args, context=context)
        due_us = gate.waited(round(when * MICRO))
        handles: list[asyncio.TimerHandle] = []

        def release() -> None:
            if not handles[0].cancelled():
                self.call_soon(fire, context=context)

        def fire() -> None:
            if handles[0].cancelled():
                return
            if gate.is_closed:
                gate.hold(release)
            elif gate.clock.monotonic_us < due_us:  # it was suspended meanwhile
                self._clock.at(gate.clock.when_us(due_us), release)
            else:
                callback(*args)

        at_s = gate.clock.when_us(due_us) / MICRO
        handles.append(super().call_at(at_s, fire, context=context))
        return handles[0]
