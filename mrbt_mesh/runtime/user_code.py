"""Calls the functions of a robot's program so that nothing they do ends the robot.

Each call ends in a result, a failure with its reason and place, or a cancellation by the runtime.
A function that cancels, exits or interrupts itself has failed, like one that raises any other
exception.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import reprlib
import signal
import threading
import traceback
import weakref
from collections.abc import Awaitable, Callable, Generator, Iterator
from contextvars import ContextVar, copy_context
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, ClassVar, TypeVar

import anyio

from mrbt_mesh.core.mission.failure_reasons import MAX_REASON, one_line
from mrbt_mesh.driven import Driven, GivenUpError, is_library
from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.runtime.never_awaited import (
    noting_where_coroutines_are_made,
    tell_of_never_awaited,
)

MAX_DETAILS = 2_000
# The number of exceptions of a group that a reason names.
MAX_NAMED = 3
_PACKAGE = Path(__file__).parent.parent


_T = TypeVar("_T")

# A task that the function started and did not await: it has failed or continues.
STRAY = "a task started by"

# The call whose code, or a task started by it, runs in the event loop now.
running_call: ContextVar[UserCall | None] = ContextVar("running_call", default=None)


class UserCodeError(Exception):
    """A function of the program has failed.

    `reason` is one line for the team, empty if the program gave none. `details`, for the log,
    includes the traceback.
    """

    def __init__(self, reason: str, details: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.details = details or reason


class UserCall:
    """One call of `function`, made by `call`. `name` says what it does: a local task, a bid.

    `report(kind, call, failure)` is called for failures besides its result. `stepping` is the call
    whose code runs now, `steps` counts the steps of all calls, and `tasks` are the tasks that carry
    out calls. `is_cancelled`: the runtime has cancelled the call. `gate`: the gate of `Driven`,
    until it is cancelled. `blocked`: where it kept the simulator waiting in real time, which makes
    it fail. `waits_for`: one line from an adapter's function on why it continues after its
    cancellation.
    """

    stepping: ClassVar[UserCall | None] = None
    steps: ClassVar[int] = 0
    tasks: ClassVar[weakref.WeakSet[asyncio.Task[Any]]] = weakref.WeakSet()

    def __init__(
        self,
        name: str,
        function: Callable[..., Any],
        call: Callable[[], Any],
        report: Callable[[str, UserCall, UserCodeError], None] = lambda *_: None,
    ) -> None:
        self.name = name
        self.function = function
        self.blocked = ""
        self.waits_for = ""
        self.report = report
        self.is_cancelled = False
        # Distinguishes its cancellation from all others that reach the function.
        self.token = f"mrbt call {id(self):x}"
        self.gate: Callable[[], Generator[Any, None, None]] | None = None
        self._call = call
        self._task: asyncio.Task[Any] | None = None
        self._scope: anyio.CancelScope | None = None
        self._driven: _Driven | None = None
        self._over = asyncio.Event()
        self._result: Any = None
        self._error: BaseException | None = None
        self._has_ended = False
        # The failure that ends the call, whatever else it does.
        self._failure: UserCodeError | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        # Tasks that the call has started, and threads that it uses.
        self.started: weakref.WeakSet[asyncio.Task[Any]] = weakref.WeakSet()
        self.threads: set[ThreadWork] = set()
        self._is_abandoned = asyncio.Event()

    async def run(self) -> Any:
        """Return the function's result, awaiting it if possible.

        Raises UserCodeError for whatever the function raised, and the cancellation if the runtime
        cancelled the call before it ended. After a cancellation, waits for the threads that the
        function has started.
        """
        self._loop, self._thread = asyncio.get_running_loop(), threading.current_thread()
        try:
            # A separate task, so that what the function leaves in it (cancel scopes, requests to
            # cancel it) ends with it.
            async with anyio.create_task_group() as group:
                group.start_soon(self._carry_out)
                try:
                    await self._over.wait()
                except anyio.get_cancelled_exc_class():
                    self._cancel()
                    raise
        except anyio.get_cancelled_exc_class():
            if not self._has_ended or self.was_cancelled:
                await self._threads_over()
                raise
        except ExceptionGroup as leftovers:
            # The function raises nothing here: anyio raises this for scopes left open.
            self._error = self._error or leftovers
        self._look_at_leftovers()
        if self._failure is not None and isinstance(self._error, asyncio.CancelledError | None):
            raise self._failure
        if self._error is not None:
            raise failure_of(self._error, self.function) from None
        return self._result

    async def _threads_over(self) -> None:
        with anyio.CancelScope(shield=True):
            while self.threads and not self._is_abandoned.is_set():
                over = [asyncio.ensure_future(each.over.wait()) for each in self.threads]
                given_up = asyncio.ensure_future(self._is_abandoned.wait())
                await asyncio.wait([*over, given_up], return_when=asyncio.FIRST_COMPLETED)
                for each in (*over, given_up):
                    each.cancel()

    def _look_at_leftovers(self) -> None:
        """Report what the function leaves running.

        A coroutine that it forgot to await is a failure.
        """
        for task in [task for task in self.started if not task.done()]:
            coroutine = task.get_coro()
            code = getattr(coroutine, "cr_code", None)
            if code is None or not users_frames([(code.co_filename, code.co_firstlineno)]):
                continue  # a library's task, which may keep a connection
            name, place = code.co_name, f"{Path(code.co_filename).name}:{code.co_firstlineno}"
            if (gathered := gathered_in_vain(task)) is not None:
                gathered.add_done_callback(lambda each: each.cancelled() or each.exception())
                self._failure = UserCodeError(
                    f"gather({name}()) was never awaited ({place}): put await before it"
                )
                task.cancel()
            else:
                remedy = "await it, or make it a background function"
                self.report(STRAY, self, UserCodeError(f"{name} goes on ({place}): {remedy}"))
        for work in self.threads:
            text = f"a thread goes on after it ({work.place}): await it"
            self.report("after the end of", self, UserCodeError(text))

    def fail(self, failure: UserCodeError) -> None:
        """End the call as failed, whatever its result; may be called from any thread."""
        if self._loop is not None and threading.current_thread() is not self._thread:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                self._loop.call_soon_threadsafe(self.fail, failure)
        elif self._has_ended:
            self.report("after the end of", self, failure)
        elif self._failure is None:
            self._failure = failure
            if self._scope is not None:
                self._scope.cancel(self.token)

    @property
    def was_cancelled(self) -> bool:
        """True if the runtime's cancellation has reached the function."""
        return self._driven is not None and self._driven.was_cancelled

    @property
    def late_failure(self) -> UserCodeError | None:
        """What the function raised instead of its cancellation, if anything."""
        if self._error is None or isinstance(self._error, asyncio.CancelledError):
            return None
        return failure_of(self._error, self.function)

    def abandon(self) -> None:
        """End the call even if it shields itself, without waiting for its threads."""
        self._is_abandoned.set()
        if self._driven is not None and self._task is not None:
            self._driven.is_given_up = True
            self._task.cancel()

    def place(self) -> str:
        """Return where the function waits now: `robot.py:12`."""
        if self._has_ended and self.threads:
            return next(iter(self.threads)).place
        frames = self._driven.frames() if self._driven is not None else []
        return place_of(self.function, frames)

    def _cancel(self) -> None:
        self.is_cancelled = True
        if self._scope is not None:
            self._scope.cancel(self.token)

    async def _carry_out(self) -> None:
        self._task = asyncio.current_task()
        assert self._task is not None
        UserCall.tasks.add(self._task)
        running_call.set(self)
        try:
            # A shield, so that the runtime cancels the function in one way only, which differs from
            # the function's own timeouts.
            with anyio.CancelScope(shield=True) as self._scope:
                if self.is_cancelled:
                    self._cancel()
                await self._drive()
        finally:
            self._over.set()

    async def _drive(self) -> None:
        try:
            self._result = self.step(self._call)
            if inspect.isawaitable(self._result):
                self._driven, self._result = _Driven(self, self._result), None
                self._result = await self._driven
        except BaseException as error:
            if is_interrupt(error):
                raise
            self._error = error
        self._has_ended = True

    def step(self, run: Callable[[], _T]) -> _T:
        """Run one step of the call's code, and raise what it raises."""
        UserCall.stepping, before = self, UserCall.stepping
        UserCall.steps += 1
        try:
            with noting_where_coroutines_are_made():
                return run()
        finally:
            UserCall.stepping = before
            if self.blocked:
                self.fail(UserCodeError(self.blocked))


class ThreadWork:
    """Work that a call runs in a thread.

    `over` is set in the event loop once the work has ended.
    """

    def __init__(self, place: str) -> None:
        self.place = place
        self.over = asyncio.Event()


def _tell_never_awaited(name: str, frames: list[tuple[str, int]]) -> bool:
    """Fail the call whose code forgot to await something. Returns False if it is no call's code."""
    call = UserCall.stepping or running_call.get()
    if call is None:
        return False
    where = place_of(call.function, frames)
    text = f"{name.rpartition('.')[2]}() was never awaited ({where}): put await before it"
    call.fail(UserCodeError(text))
    return True


tell_of_never_awaited(_tell_never_awaited)


def gathered_in_vain(task: asyncio.Task[Any]) -> asyncio.Future[Any] | None:
    """Return the future of the `asyncio.gather` that made this task, if nobody awaits it."""
    # asyncio has no public API for this: the callback of each of its tasks holds the future.
    for callback, _ in getattr(task, "_callbacks", None) or ():
        if getattr(callback, "__qualname__", "") == "gather.<locals>._done_callback":
            names = zip(callback.__code__.co_freevars, callback.__closure__ or (), strict=True)
            outer = {name: cell.cell_contents for name, cell in names}.get("outer")
            if isinstance(outer, asyncio.Future) and not outer.done():
                return None if getattr(outer, "_callbacks", None) else outer
    return None


class _Driven(Driven):
    """What a call awaits, driven step by step."""

    def __init__(self, owner: UserCall, awaitable: Awaitable[Any]) -> None:
        super().__init__(awaitable, owner.token, owner.step)
        self.was_cancelled = False
        self.gate = owner.gate
        self._owner = owner

    def cancelled(self) -> None:
        self.was_cancelled |= self._owner.is_cancelled
        if self.was_cancelled:
            self.gate = None  # the function may now finish what must not be left undone


def outside(function: Callable[..., None], *arguments: Any) -> None:
    """Call a function of the robot itself, so that its work is not part of the running call."""
    context = copy_context()
    context.run(running_call.set, None)
    context.run(function, *arguments)


# -- failures ---------------------------------------------------------------------------------


def failure_of(error: BaseException, function: Callable[..., Any]) -> UserCodeError:
    """Return what a function raised as a failure, whose reason names the place in the program.

    For an exception group, the reason names its first real exceptions.
    """
    if isinstance(error, UserCodeError):
        return error
    if isinstance(error, GivenUpError):
        remedy = "raise the cancellation again where it is caught"
        return UserCodeError(f"{error} and was ended: {remedy}")
    try:
        return _failure(error, function)
    except Exception:  # an exception that cannot even be formatted
        return UserCodeError(type(error).__name__)


def _failure(error: BaseException, function: Callable[..., Any]) -> UserCodeError:
    raised = list(_exceptions_in(error))
    declared = next((each for each in raised if isinstance(each, TaskFailedError)), None)
    if declared is not None:
        reason = str(declared)
        return UserCodeError(reason, reason or "failed")
    details = "".join(traceback.format_exception(error, limit=-8))[-MAX_DETAILS:]
    # A cancellation beside other exceptions of a group was caused by them.
    real = [each for each in raised if not isinstance(each, asyncio.CancelledError)] or raised
    count = min(len(real), MAX_NAMED)
    named = [_one_failure(each, function, count) for each in real[:count]]
    if len(real) > MAX_NAMED:
        named.append(f"{len(real) - MAX_NAMED} more")
    return UserCodeError("; ".join(named), details)


def _exceptions_in(error: BaseException) -> Iterator[BaseException]:
    """Yield the exception, or those of a group and its nested groups, in order."""
    waiting = [error]
    while waiting:
        each = waiting.pop()
        if isinstance(each, BaseExceptionGroup):
            waiting += reversed(each.exceptions)
        else:
            yield each


def _one_failure(error: BaseException, function: Callable[..., Any], count: int) -> str:
    """Return `KeyError: 'grip' (robot.py:12)`, no longer than its share of a reason."""
    text = "".join(traceback.format_exception_only(error)).strip()
    if isinstance(error, asyncio.CancelledError):
        text = "CancelledError: the program cancelled it, or what it waited for"
    frames = [
        (frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)
    ]
    where = f" ({place_of(function, frames)})"
    most = MAX_REASON // count - len(where) - (10 if count > 1 else 0)
    return one_line(text)[: max(most, 20)].rstrip() + where


def wrong_result(function: Callable[..., Any], result: Any, expected: str) -> UserCodeError:
    """Return the failure of a function with an invalid result; `expected` is the remedy."""
    code = code_of(function)
    name = code.co_name if code is not None else "the function"
    where = place_of(function, [])
    return UserCodeError(one_line(f"{name} returned {shown(result)} ({where}): {expected}"))


def shown(value: Any) -> str:
    """Return a short text for any value, for a message."""
    try:
        text = reprlib.repr(value)
    except Exception:
        text = f"an object of {type(value).__name__}"
    return text if len(text) <= 60 else text[:59] + "…"


# -- places -----------------------------------------------------------------------------------


def code_of(function: Callable[..., Any]) -> CodeType | None:
    """Return the code of a function, even a decorated or partially applied one."""
    function = inspect.unwrap(function)
    while isinstance(function, partial):
        function = inspect.unwrap(function.func)
    code = getattr(function, "__code__", None)
    return code if isinstance(code, CodeType) else None


def place_of(function: Callable[..., Any], frames: list[tuple[str, int]]) -> str:
    """Return the innermost of `frames` (outermost first) that is the program's: `robot.py:12`.

    Frames from the program's folder come first, then any that are neither this package's nor
    Python's. If there are none, it is where the function begins.
    """
    code = code_of(function)
    folder = Path(code.co_filename).parent if code is not None else None
    others = [place for place in frames if not is_ours(Path(place[0]))]
    own = [place for place in others if folder is not None and Path(place[0]).parent == folder]
    own = own or users_frames(frames)
    if not own and code is not None:
        own = [(code.co_filename, code.co_firstlineno)]
    file, line = (own or others or [("?", 0)])[-1]
    return f"{Path(file).name}:{line}"


def users_frames(frames: list[tuple[str, int]]) -> list[tuple[str, int]]:
    """Return the frames that belong neither to Python nor to this package."""
    files = {file: Path(file) for file, _ in frames}
    return [(f, line) for f, line in frames if not is_library(files[f]) and not is_ours(files[f])]


def is_ours(file: Path) -> bool:
    """True for files of this package, except the adapters, which are robots' programs."""
    return file.is_relative_to(_PACKAGE) and not file.is_relative_to(_PACKAGE / "adapters")


def frames_of(frame: FrameType | None) -> list[tuple[str, int]]:
    """Return file and line of a frame and its callers, outermost first."""
    found = [(each.f_code.co_filename, line) for each, line in traceback.walk_stack(frame)]
    return found[::-1]


# -- interrupts -------------------------------------------------------------------------------


def is_interrupt(error: BaseException) -> bool:
    """True if Ctrl-C was pressed, and the program did not raise this itself."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    if threading.current_thread() is not threading.main_thread():
        return False
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        return True
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and frames[-1].f_code.co_name == "_on_sigint"
