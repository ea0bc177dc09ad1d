"""When one process comes to run: at once, only now and then, or not at all while it is frozen."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from mrbt_mesh.core.agent.inputs import Input, TimerFired, together
from mrbt_mesh.runtime.inbox import MAX_WAITING
from mrbt_mesh.sim.world.clock import Gate, VirtualClock


class Pace:
    """Keeps what comes in while the process does not run, and then has it handled.

    `is_held`: whether inputs have to wait. `is_slow`: until it has come round once more after it
    was made fast again. `gate` holds back the timers of the robot's program in the same way.
    """

    def __init__(self, clock: VirtualClock, gate: Gate, handle: Callable[[Input], None]) -> None:
        self.gate = gate
        self.is_held = False
        self.is_frozen = False
        self.is_slow = False
        self.is_over = False
        self._clock = clock
        self._handle = handle
        self._lag_us = 0
        # A bounded queue, as the real one: the oldest are lost.
        self._waiting: deque[Input] = deque(maxlen=MAX_WAITING)

    def keep(self, event: Input) -> None:
        """Let an input wait."""
        self._waiting.append(event)

    def freeze(self) -> None:
        """Nothing of the process runs."""
        self.is_frozen = self.is_held = True
        self.gate.close()

    def thaw(self) -> None:
        """It runs again: the agent looks at the clock before anything else goes on."""
        if self.is_frozen:
            self.is_frozen = False
            self.is_held = bool(self._lag_us)
            self._waiting.appendleft(TimerFired())
            self._catch_up()

    def slow(self, lag_us: int) -> None:
        """Come round only every `lag_us` from now on; 0: be fast again after the next time."""
        self._lag_us = lag_us
        self.is_held = self.is_frozen or bool(lag_us)
        if lag_us and not self.is_slow:
            self.is_slow = True
            self.gate.close()
            self._wake_later()

    def end(self) -> None:
        """The process has ended."""
        self.is_over = True
        self.gate.open()

    def _wake_later(self) -> None:
        self._clock.at(self._clock.now_us + self._lag_us, self._wake)

    def _wake(self) -> None:
        if self.is_over:
            return
        self.is_slow = bool(self._lag_us)
        if not self.is_frozen:
            self._catch_up()
        if self.is_slow:
            self._wake_later()

    def _catch_up(self) -> None:
        """Handle what has waited, then let the program's timers go on."""
        waiting = list(self._waiting)
        self._waiting.clear()
        for event in together(waiting):
            self._handle(event)
        self.gate.open()
        if self.is_slow and not self.is_over:
            self.gate.close()
