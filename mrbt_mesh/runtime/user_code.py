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
import sysconfig
import threading
import traceback
import weakref
from collections.abc import Awaitable, Callable, Coroutine, Generator, Iterator
from contextvars import ContextVar, copy_context
from functools import partial
from pathlib import Path
from types import CodeType, FrameType
from typing import Any, ClassVar, NoReturn, TypeVar

import anyio

from mrbt_mesh.core.mission.failure_reasons import MAX_REASON, one_line
from mrbt_mesh.errors import TaskFailedError

MAX_DETAILS = 2_000
# The number of exceptions of a group that a reason names.
MAX_NAMED = 3
# A function that swallows this many cancellations in a row will not stop by itself.
MAX_SWALLOWED = 1_000

_PACKAGE = Path(__file__).parent.parent
_LIBRARIES = tuple(Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib"))


_T = TypeVar("_T")

# The call in whose code, or in a task started by it, the event loop is now.
running_call: ContextVar[UserCall | None] = ContextVar("running_call", default=None)


class UserCodeError(Exception):
    """A function of the program has failed. `reason` is one line for the team, empty where the
    program gave none; `details`, for the log, has the traceback.
    """

    def __init__(self, reason: str, details: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.details = details or reason


class UserCall:
    """One call of `function`, made by `call`. `name` is what it does: a local task, a bid.

    `report` is called for failures beside its result: the kind, the call, the failure. `stepping`
    is the call whose code runs now, in the `steps`-th step of any; `tasks` carry out calls.
    `is_cancelled`: the runtime has cancelled it.
    `blocked`: where it kept the simulator waiting in real time, which has made it fail.
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
        self.report = report
        self.is_cancelled = False
        # By which its cancellation differs from all others that reach the function.
        self.token = f"mrbt call {id(self):x}"
        self._call = call
        self._task: asyncio.Task[Any] | None = None
        self._scope: anyio.CancelScope | None = None
        self._driven: _Driven | None = None
        self._over = asyncio.Event()
        self._result: Any = None
        self._error: BaseException | None = None
        self._has_ended = False

    async def run(self) -> Any:
        """The function's result, awaited if it can be.

        Raises UserCodeError for whatever the function raised, and the cancellation if the runtime
        cancelled it before it had ended.
        """
        try:
            # A task of its own: what the function leaves behind in it (cancel scopes, requests to
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
                raise
        except ExceptionGroup as leftovers:
            # The function itself raises nothing here: this is anyio's, of scopes left open.
            self._error = self._error or leftovers
        if self._error is not None:
            raise failure_of(self._error, self.function) from None
        return self._result

    @property
    def was_cancelled(self) -> bool:
        """Whether the cancellation by the runtime has reached the function."""
        return self._driven is not None and self._driven.was_cancelled

    @property
    def late_failure(self) -> UserCodeError | None:
        """What it raised in place of the cancellation, if anything."""
        if self._error is None or isinstance(self._error, asyncio.CancelledError):
            return None
        return failure_of(self._error, self.function)

    def abandon(self) -> None:
        """End it, whatever it shields itself from."""
        if self._driven is not None and self._task is not None:
            self._driven.is_abandoned = True
            self._task.cancel()

    def place(self) -> str:
        """Where the function waits now: `robot.py:12`."""
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
            # A shield, so that the runtime cancels the function in one way only, which it can tell
            # from the timeouts of the function's own.
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
        """Run one step of its code. Raises what that raises, and UserCodeError if it blocked."""
        UserCall.stepping = self
        UserCall.steps += 1
        try:
            return run()
        finally:
            UserCall.stepping = None
            if self.blocked:
                raise UserCodeError(self.blocked)


class _Driven:
    """Awaits something, and counts how often the runtime has cancelled it.

    What goes on after MAX_SWALLOWED cancellations is ended. Timeouts of its own (`move_on_after`,
    `asyncio.timeout`) arrive as cancellations too; these do not count.
    """

    def __init__(self, owner: UserCall, awaitable: Awaitable[Any]) -> None:
        self.was_cancelled = False
        self._cancellations = 0
        self.is_abandoned = False
        self._owner = owner
        self._coroutine: Coroutine[Any, Any, Any] = (
            awaitable if inspect.iscoroutine(awaitable) else _awaited(awaitable)
        )

    def frames(self) -> list[tuple[str, int]]:
        """Where it waits: file and line, the outermost first."""
        found = []
        each: Any = self._coroutine
        while (frame := getattr(each, "cr_frame", None)) is not None:
            found.append((frame.f_code.co_filename, frame.f_lineno))
            each = each.cr_await
        return found

    def __await__(self) -> Generator[Any, None, Any]:
        step = partial(self._coroutine.send, None)
        while True:
            try:
                awaited = self._owner.step(step)
            except StopIteration as end:
                return end.value
            try:
                yield awaited
                step = partial(self._coroutine.send, None)
            except asyncio.CancelledError as cancellation:
                self.was_cancelled |= self._owner.is_cancelled
                self._cancellations += any(
                    isinstance(text, str) and self._owner.token in text
                    for text in cancellation.args
                )
                if self.is_abandoned or self._cancellations > MAX_SWALLOWED:
                    del step
                    self._end()
                step = partial(self._coroutine.throw, cancellation)
            except BaseException:
                self._coroutine.close()
                raise

    def _end(self) -> NoReturn:
        """Drop the coroutine, here in the event loop: it may go on forever where there is none."""
        place = self.frames()
        with contextlib.suppress(RuntimeError):  # it ignores this too
            self._coroutine.close()
        self._coroutine = _awaited(None)
        self._coroutine.close()
        file, line = place[-1] if place else ("?", 0)
        where = f"({Path(file).name}:{line})"
        if self.is_abandoned:
            raise UserCodeError(f"still ran when the robot ended {where}") from None
        raise UserCodeError(
            f"goes on after {MAX_SWALLOWED} cancellations {where} and was ended: raise the "
            "cancellation again where it is caught"
        ) from None


async def _awaited(awaitable: Any) -> Any:
    return await awaitable


def outside(function: Callable[..., None], *arguments: Any) -> None:
    """Call a function of the robot's: what it does is not done by the call that is running."""
    context = copy_context()
    context.run(running_call.set, None)
    context.run(function, *arguments)


# -- failures ---------------------------------------------------------------------------------


def failure_of(error: BaseException, function: Callable[..., Any]) -> UserCodeError:
    """What a function raised as a failure: its reason names the place in the program.

    Of an exception group the first real exceptions are named.
    """
    if isinstance(error, UserCodeError):
        return error
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
    # A cancellation beside other exceptions of a group came from these.
    real = [each for each in raised if not isinstance(each, asyncio.CancelledError)] or raised
    count = min(len(real), MAX_NAMED)
    named = [_one_failure(each, function, count) for each in real[:count]]
    if len(real) > MAX_NAMED:
        named.append(f"{len(real) - MAX_NAMED} more")
    return UserCodeError("; ".join(named), details)


def _exceptions_in(error: BaseException) -> Iterator[BaseException]:
    """The exception, or those of a group and its groups, in their order."""
    waiting = [error]
    while waiting:
        each = waiting.pop()
        if isinstance(each, BaseExceptionGroup):
            waiting += reversed(each.exceptions)
        else:
            yield each


def _one_failure(error: BaseException, function: Callable[..., Any], count: int) -> str:
    """`KeyError: 'grip' (robot.py:12)`, not longer than its share of a reason."""
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
    """The failure of a function that returned a wrong value; `expected` is the remedy."""
    code = code_of(function)
    name = code.co_name if code is not None else "the function"
    where = place_of(function, [])
    return UserCodeError(one_line(f"{name} returned {shown(result)} ({where}): {expected}"))


def shown(value: Any) -> str:
    """A value for a message: short, whatever it is."""
    try:
        text = reprlib.repr(value)
    except Exception:
        text = f"an object of {type(value).__name__}"
    return text if len(text) <= 60 else text[:59] + "…"


# -- places -----------------------------------------------------------------------------------


def code_of(function: Callable[..., Any]) -> CodeType | None:
    """The code of a function, also of a decorated or partly applied one."""
    function = inspect.unwrap(function)
    while isinstance(function, partial):
        function = inspect.unwrap(function.func)
    code = getattr(function, "__code__", None)
    return code if isinstance(code, CodeType) else None


def place_of(function: Callable[..., Any], frames: list[tuple[str, int]]) -> str:
    """The innermost of `frames`, outermost first, that is the program's: `robot.py:12`.

    Of code of the program's folder, else of any that is neither ours nor Python's; with none, it is
    where the function begins.
    """
    code = code_of(function)
    folder = Path(code.co_filename).parent if code is not None else None
    others = [place for place in frames if not _is_ours(Path(place[0]))]
    own = [place for place in others if folder is not None and Path(place[0]).parent == folder]
    own = own or users_frames(frames)
    if not own and code is not None:
        own = [(code.co_filename, code.co_firstlineno)]
    file, line = (own or others or [("?", 0)])[-1]
    return f"{Path(file).name}:{line}"


def users_frames(frames: list[tuple[str, int]]) -> list[tuple[str, int]]:
    """Those that are neither Python's nor this package's."""
    files = {file: Path(file) for file, _ in frames}
    return [(f, line) for f, line in frames if not _is_library(files[f]) and not _is_ours(files[f])]


def _is_ours(file: Path) -> bool:
    """Of this package, but for the adapters, which are robots' programs."""
    return file.is_relative_to(_PACKAGE) and not file.is_relative_to(_PACKAGE / "adapters")


def _is_library(file: Path) -> bool:
    return not file.is_absolute() or any(file.is_relative_to(each) for each in _LIBRARIES)


def frames_of(frame: FrameType | None) -> list[tuple[str, int]]:
    """File and line of a frame and its callers, the outermost first."""
    found = [(each.f_code.co_filename, line) for each, line in traceback.walk_stack(frame)]
    return found[::-1]


# -- interrupts -------------------------------------------------------------------------------


def is_interrupt(error: BaseException) -> bool:
    """Whether Ctrl-C was pressed, and the program has not raised this itself."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    if threading.current_thread() is not threading.main_thread():
        return False
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        return True
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and frames[-1].f_code.co_name == "_on_sigint"
