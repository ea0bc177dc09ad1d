"""Processes beside the team of a drill, such as the world of its robots."""

from __future__ import annotations

import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from mrbt_mesh.errors import InputError

# Environment variable with the folder where robots and these processes find each other's sockets.
FOLDER_VARIABLE = "MRBT_BESIDE"
END_TIMEOUT_S, CHECK_TIMEOUT_S = 5.0, 30.0
MAX_SAID = 300


class BesideError(InputError):
    """A process does not start; the message has its name and the reason."""


@dataclass(frozen=True)
class Check:
    """The result of a check command at the end of a drill; `status` is None after a timeout."""

    command: str
    status: int | None
    said: str


def words(command: str) -> list[str]:
    """Split a command into words; `python` becomes the current interpreter. Raises ValueError."""
    found = shlex.split(command)
    if not found:
        raise ValueError("no command")
    return [sys.executable, *found[1:]] if found[0] == "python" else found


class Beside:
    """Processes that start before the team and end after it, in the folder `folder`."""

    def __init__(self, folder: Path, shared: Path, environment: Mapping[str, str]) -> None:
        self.environment = {FOLDER_VARIABLE: str(shared)}
        self._folder = folder
        self._shared = shared
        self._around = {**environment, **self.environment}
        self._processes: list[tuple[str, subprocess.Popen[bytes], Path]] = []

    def start(self, command: str) -> None:
        """Start a process. Raises BesideError if there is no such program."""
        path = self._shared / f"{len(self._processes) + 1}.log"
        try:
            with path.open("wb") as log:
                process = subprocess.Popen(
                    words(command),
                    cwd=self._folder,
                    env=self._around,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                )
        except OSError as error:
            raise BesideError(f"{command}: {error.strerror}") from None
        self._processes.append((command, process, path))

    def ended(self) -> list[str]:
        """Return those that have ended, each with its status and its last output."""
        return [
            f"{command} has ended with status {process.returncode}: {_tail(path.read_bytes())}"
            for command, process, path in self._processes
            if process.poll() is not None
        ]

    def check(self, command: str) -> Check:
        """Run a command to its end."""
        try:
            done = subprocess.run(
                words(command),
                cwd=self._folder,
                env=self._around,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                timeout=CHECK_TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Check(command, None, f"no answer within {CHECK_TIMEOUT_S:g} s")
        except OSError as error:
            return Check(command, None, str(error.strerror))
        return Check(command, done.returncode, _tail(done.stdout))

    def end(self) -> None:
        """Send SIGTERM to all, and SIGKILL to those that ignore it."""
        for _, process, _ in self._processes:
            process.terminate()
        for _, process, _ in self._processes:
            try:
                process.wait(END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _tail(said: bytes) -> str:
    text = " ".join(said.decode(errors="replace").split())
    return text if len(text) <= MAX_SAID else "..." + text[-MAX_SAID:]


@contextmanager
def beside(
    commands: Sequence[str], folder: Path, environment: Mapping[str, str]
) -> Iterator[Beside]:
    """Run the processes of a drill. Raises BesideError."""
    with tempfile.TemporaryDirectory(prefix="mrbt-") as shared:
        found = Beside(folder, Path(shared), environment)
        try:
            for command in commands:
                found.start(command)
            yield found
        finally:
            found.end()
