"""An event loop that a robot's program cannot end, and a watchdog thread that notices blocking.

Blocking code stops a robot's whole event loop. The thread names the place at that time: the loop
itself could report it only afterwards, and by then the team has declared the robot dead.
"""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrbt_mesh.runtime.threads import in_noted_thread
from mrbt_mesh.runtime.user_code import (
    STRAY,
    UserCall,
    UserCodeError,
    failure_of,
    frames_of,
    is_interrupt,
    place_of,
    running_call,
    users_frames,
)

# A step that the watchdog sees this many times in a row blocks the loop.
LOOKS = 2
# An exception of a failed task that is not retrieved by then will not be.
UNSEEN_S = 1.0
_logger = logging.getLogger("mrbt_mesh")


class RobotTask(asyncio.Task[Any]):
    """A task that the robot's program cannot cancel, unless the task runs code of the program.

    `for each in asyncio.all_tasks(): each.cancel()` would end the robot.
    """

    def cancel(self, msg: Any | None = None) -> bool:
        call = running_call.get()
        if call is None or self in UserCall.tasks:
            return super().cancel(msg)
        where = place_of(call.function, frames_of(sys._getframe(1)))
        text = f"cancels tasks of the robot, which go on ({where}): cancel only your own"
        call.report("cancellation in", call, UserCodeError(text))
        return False


def _new_task(loop: asyncio.AbstractEventLoop, coro: Any, **options: Any) -> asyncio.Task[Any]:
    kind = RobotTask if running_call.get() is None else asyncio.Task
    return kind(coro, loop=loop, **options)


class RobotLoop(asyncio.SelectorEventLoop):
    """asyncio's selector loop, with three differences.

    Calls that end a loop from inside (`sys.exit` in an asyncio task, `stop`) do not end this one. A
    program cannot cancel the robot's tasks. A task that a program starts by itself belongs to the
    call that started it, which reports its failure.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._owners: weakref.WeakKeyDictionary[asyncio.Task[Any], UserCall] = (
            weakref.WeakKeyDictionary()
        )
        self.set_exception_handler(_tell_owner)
        self.set_task_factory(_new_task)

    def run_forever(self) -> None:
        while True:
            try:
                super().run_forever()
            except (SystemExit, KeyboardInterrupt) as error:
                if is_interrupt(error):
                    raise
                _logger.error("the program tried to end the process", exc_info=error)
            else:
                return

    def stop(self) -> None:
        if asyncio.current_task(self) is not None:
            raise RuntimeError("a robot's program cannot stop the event loop of the robot")
        super().stop()

    def create_task(self, coro: Any, **options: Any) -> asyncio.Task[Any]:
        task: asyncio.Task[Any] = super().create_task(coro, **options)
        call = running_call.get()
        if call is not None:
            self._owners[task] = call
            call.started.add(task)
            task.add_done_callback(self._ended)
        return task

    def run_in_executor(self, executor: Any, func: Any, *arguments: Any) -> Any:  # type: ignore[override]
        return in_noted_thread(super().run_in_executor, executor, func, *arguments)

    def _ended(self, task: asyncio.Task[Any]) -> None:
        if not task.cancelled() and _is_unseen(task):
            self.call_later(UNSEEN_S, self._look, task)

    def _look(self, task: asyncio.Task[Any]) -> None:
        """Report a failure that was not retrieved; asyncio would wait until the task is deleted."""
        call = self.owner_of(task)
        if call is not None and _is_unseen(task) and (error := task.exception()) is not None:
            call.report(STRAY, call, failure_of(error, call.function))

    def owner_of(self, task: Any) -> UserCall | None:
        """Return the program's call that started a task."""
        return self._owners.get(task) if isinstance(task, asyncio.Task) else None


def _is_unseen(task: asyncio.Task[Any]) -> bool:
    # asyncio has no public API for this; the attribute is as old as its tasks.
    return bool(getattr(task, "_log_traceback", False))


def _tell_owner(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """asyncio's exception handler: a task that is not awaited, or a callback, has failed."""
    assert isinstance(loop, RobotLoop)
    task, error = context.get("future") or context.get("task"), context.get("exception")
    scheduled = getattr(context.get("handle"), "_context", None)
    call = loop.owner_of(task) or (scheduled.get(running_call) if scheduled else None)
    if call is None or error is None:
        loop.default_exception_handler(context)
    else:
        call.report(STRAY, call, failure_of(error, call.function))


class LoopWatchdog:
    """A thread that reports blocking code, once per step that blocks.

    `step` identifies what the watched thread does: the same number during a step, None while it
    waits. `tell` is called in the watchdog's thread after `limit_s` in one step, with the frames of
    the watched thread, outermost first.
    """

    def __init__(
        self,
        limit_s: float,
        step: Callable[[], int | None],
        tell: Callable[[list[tuple[str, int]]], None],
    ) -> None:
        self._limit_s = limit_s
        self._step = step
        self._tell = tell
        self._watched = threading.get_ident()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="mrbt watchdog", daemon=True)

    def __enter__(self) -> LoopWatchdog:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        """Count checks rather than seconds: when the whole machine is suspended, no robot is
        blamed.
        """
        seen, looks = self._step(), 0
        while not self._over.wait(self._limit_s / LOOKS):
            now = self._step()
            looks = looks + 1 if now is not None and now == seen else 0
            seen = now
            if looks == LOOKS:
                self._tell(frames_of(sys._current_frames().get(self._watched)))


def blocking_place(call: UserCall | None, frames: list[tuple[str, int]]) -> str | None:
    """Return what blocks, and where: `local task mow(1) at robot.py:12`.

    None: no program's code.
    """
    if call is not None:
        return f"{call.name} at {place_of(call.function, frames)}"
    own = users_frames(frames)
    return f"{Path(own[-1][0]).name}:{own[-1][1]}" if own else None
