"""The lock by which robots know that their launcher lives: it holds the lock, they wait for it.

The kernel frees the lock (flock) however the launcher ends, so no process needs to compare pids or
to poll. A robot that joins a run waits for the run's launcher, not for the process that started it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import TYPE_CHECKING

from mrbt_mesh.runtime.process_identity import identity_of_this_process, process_in
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError

if TYPE_CHECKING:
    import psutil

# A robot that has not left by then never will, e.g. because its program blocks it.
LEAVE_LIMIT_S = 10.0
LOOKS, LOCK_TRIES, LOOK_S = 100, 10, 0.01


@contextlib.contextmanager
def launched_from_here(run_dir: RunDir) -> Iterator[None]:
    """Robots of this run that are started in this context leave as soon as this process ends.

    Raises RunDirError if another process has launched them, or if the file cannot be locked.
    """
    path = run_dir.launcher_lock_path
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise RunDirError(f"cannot write the run directory: {error}") from error
    try:
        try:
            _lock(descriptor)
        except BlockingIOError:
            raise RunDirError(f"{run_dir.path}: another process runs this team") from None
        except OSError as error:
            text = f"{path} cannot be locked ({error.strerror}): put --run-dir on a local disk"
            raise RunDirError(text) from error
        try:
            os.ftruncate(descriptor, 0)
            os.write(descriptor, identity_of_this_process().encode())
        except OSError as error:
            raise RunDirError(f"cannot write the run directory: {error}") from error
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int) -> None:
    """Lock the file. Retries, since `is_launched` in another process may hold the lock briefly."""
    for tries_left in reversed(range(LOCK_TRIES)):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if not tries_left:
                raise
            time.sleep(LOOK_S)


def is_launched(run_dir: RunDir) -> bool:
    """Return whether the run has a living launcher; a detached run has none."""
    try:
        descriptor = os.open(run_dir.launcher_lock_path, os.O_RDONLY)
    except FileNotFoundError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False


def launcher_of(run_dir: RunDir) -> psutil.Process | None:
    """Return the process that launched the run's robots, if it lives on this machine."""
    for _ in range(LOOKS):
        if not is_launched(run_dir):
            break
        # The launcher writes its identity right after it has locked the file.
        if process := process_in(run_dir.launcher_lock_path):
            return process
        time.sleep(LOOK_S)
    return None


class LauncherWatch:
    """Reports when no process holds the lock on `file` any more, even if the event loop is blocked.

    The process ends at most `limit_s` later. Raises OSError if the file cannot be opened.
    """

    def __init__(self, file: Path, limit_s: float = LEAVE_LIMIT_S) -> None:
        self._descriptor = os.open(file, os.O_RDONLY)
        self._limit_s = limit_s
        self._gone: Future[None] = Future()
        threading.Thread(target=self._wait, name="launcher watch", daemon=True).start()

    def call_when_gone(self, tell: Callable[[], None]) -> None:
        """Call `tell` in another thread once the launcher has ended; at once if it already has."""
        self._gone.add_done_callback(lambda _: tell())

    def _wait(self) -> None:
        with contextlib.suppress(OSError):
            fcntl.flock(self._descriptor, fcntl.LOCK_SH)
        os.close(self._descriptor)
        self._gone.set_result(None)
        threading.Event().wait(self._limit_s)
        os._exit(0)
