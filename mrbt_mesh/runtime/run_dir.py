"""The run directory: where `up`, `join`, `kill` and `status` find a run and its processes.

run.json            how the run was started (RunInfo)
mission.json        the compiled mission
revision.json       the last revision of it that was taken up
launcher.lock       locked by the process that launched the robots, as long as it lives; which
                    one that is
keys/               the keys of all members (see `key_folder`)
<robot>.process     which process is the robot's (see `process_identity`), written by itself;
                    its modification time is the last sign of life
<robot>.blocked     what blocks its event loop, while it does
<robot>.died        why its process ended, where it could still write that
<robot>.log         its log, JSON lines; <robot>.out: what it printed. What is too long becomes
                    <robot>.log.1, and so on
fork_server.out     what was printed by the process that forks the robots: nothing, unless it fails
events.jsonl        the physical truth, written by the robots
recordings/         what each robot knew and did (see `recording.folder`)
run.mcap            what `up` heard of it
commands.jsonl      what operators commanded by commands and views (see `command_log`)
deaths.json         the times of its deaths, as `up` and `drill` have them
summary.json        written by `up` at the end; for a detached team by `cli/finished.py`
summary.signature   its signature, in a team with keys (see `summary_signature`)
summary_writer.out  what was printed by that process: nothing, unless it fails
metrics-targets.json  where robots serve metrics, as Prometheus reads it (file_sd_configs)
"""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.recording.folder import FOLDER as RECORDINGS
from mrbt_mesh.runtime.private_files import check_folder, private_opener
from mrbt_mesh.runtime.process_identity import (
    clock_id,
    identity_of_this_process,
    is_this_clock,
    process_in,
)
from mrbt_mesh.runtime.robot_options import RobotOptions

if TYPE_CHECKING:  # short commands do not need these
    import psutil

    from mrbt_mesh.core.facts.store import Incarnation
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.observer.episodes import DeathTimes, MajorFault

KEYS_FOLDER = "keys"
RUN_FILE, MISSION_FILE, SUMMARY_FILE = "run.json", "mission.json", "summary.json"
SIGNATURE_FILE = "summary.signature"
REVISION_FILE = "revision.json"
DEATHS_FILE, COMMANDS_FILE = "deaths.json", "commands.jsonl"
_STATE = "MRBT_STATE_DIR"


class RunDirError(InputError):
    """A run directory is missing or cannot be used; the message has the remedy."""


@dataclass(frozen=True)
class Place:
    """Where a robot's process runs: its address, and a prefix for its command line."""

    address: str
    prefix: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunInfo:
    """How a run was started: everything that another process needs to join or to watch it.

    `options` are shared by all robots. `dials` lists the robots that each robot connects to; of
    every pair, one side dials. With routers in `options.routers`, robots have no endpoints of their
    own. `places` is empty for a team on loopback. `record`: the robots record what they know and
    do. `metrics_ports` are the loopback ports on which robots serve metrics; empty if they serve
    none.
    """

    mission_path: str
    mission_name: str
    options: RobotOptions
    endpoints: Mapping[str, str]
    dials: Mapping[str, list[str]]
    started_unix_s: float
    robots: tuple[str, ...]
    places: Mapping[str, Place] = field(default_factory=dict)
    record: bool = False
    metrics_ports: Mapping[str, int] = field(default_factory=dict)

    @property
    def team(self) -> str:
        """The name of the team."""
        return str(self.options.team)

    @property
    def run(self) -> str:
        """The id of the run."""
        return str(self.options.run)


def state_dir() -> Path:
    """Where runs are kept by default: $MRBT_STATE_DIR, else the XDG state folder.

    Raises InputError for a user who has no home folder, as in some containers.
    """
    given = os.environ.get(_STATE)
    if given:
        return Path(given)
    base = os.environ.get("XDG_STATE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".local" / "state") / "mrbt"
    except RuntimeError:
        raise InputError(
            f"there is no folder for runs: this user (uid {os.getuid()}) has no home folder; "
            f"set {_STATE}=DIR, or HOME"
        ) from None


def write_atomically(path: Path, text: str) -> None:
    """Write a file that readers never see half written. Raises OSError."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with open(temporary, "wb", opener=private_opener) as file:
            file.write(text.encode(errors="surrogateescape"))
        temporary.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def _overwrite(path: Path, text: str) -> bool:
    """Overwrite an existing file in place; return True on success.

    The text is padded with blanks to the old size, which JSON ignores.
    """
    data = text.encode()
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_NOFOLLOW)
        try:
            data = data.ljust(os.fstat(descriptor).st_size)
            return os.write(descriptor, data) == len(data)
        finally:
            os.close(descriptor)
    except OSError:
        return False


def _write(path: Path, text: str) -> None:
    try:
        write_atomically(path, text)
    except OSError as error:
        raise _unwritable(path, error) from error


def _unwritable(path: Path, error: OSError, what: str = "written") -> RunDirError:
    return RunDirError(
        f"{path} cannot be {what}: {error.strerror or error}; nothing is lost: make room on its "
        "disk, or have it mounted for writing, and give the command again"
    )


def _summary_text(summary: Mapping[str, Any]) -> str:
    return json.dumps(summary, indent=2) + "\n"


class RunDir:
    """One run directory."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.keys_path = path / KEYS_FOLDER
        self.launcher_lock_path = path / "launcher.lock"
        self.metrics_targets_path = path / "metrics-targets.json"
        self.fork_server_output_path = path / "fork_server.out"

    @property
    def mission_path(self) -> Path:
        """The mission that robots start with: the last revision known to be in force."""
        revised = self.path / REVISION_FILE
        return revised if revised.exists() else self.path / MISSION_FILE

    def save_revision(self, mission: Mission) -> None:
        """Save a revision that robots start with from now on. Raises RunDirError."""
        from mrbt_mesh.core.mission.compiled import compile_mission

        _write(self.path / REVISION_FILE, compile_mission(mission))

    def is_run_of(self, mission: Mission) -> bool:
        """Return True if the run began with this mission, or if it is the one in force."""
        from mrbt_mesh.core.mission.compiled import mission_from_compiled
        from mrbt_mesh.features.revisions.section import without_revision

        paths = self.mission_path, self.path / MISSION_FILE
        known = (
            mission_from_compiled(path.read_text(encoding="utf-8"), str(path)) for path in paths
        )
        return any(without_revision(each).digest == mission.digest for each in known)

    @classmethod
    def create(cls, path: Path, info: RunInfo, compiled_mission: str) -> RunDir:
        """Create the directory of a new run.

        Raises RunDirError if it already holds a run or cannot be written.
        """
        if (path / RUN_FILE).exists():
            raise RunDirError(
                f"{path} already holds a run: choose another --run-dir, or add --continue"
            )
        if path.exists() and not path.is_dir():
            raise RunDirError(f"--run-dir {path}: is a file; name a folder")
        check_folder(path, "the run directory")
        check_folder(path / KEYS_FOLDER, "the folder of keys")
        check_folder(path / RECORDINGS, "the folder of recordings")
        run_dir = cls(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir(exist_ok=True, mode=0o700)
            write_atomically(path / MISSION_FILE, compiled_mission)
            run_dir.save(info)
        except OSError as error:
            run_dir.discard()
            raise RunDirError(f"cannot write the run directory: {error}") from error
        except RunDirError:
            run_dir.discard()
            raise
        return run_dir

    def discard(self) -> None:
        """Remove a run that `create` has made and of which no robot was started."""
        made = self.path / RUN_FILE, self.path / MISSION_FILE, self.metrics_targets_path
        with contextlib.suppress(OSError):
            for path in made:
                path.unlink(missing_ok=True)
            self.path.rmdir()  # if nothing else is in it

    @classmethod
    def of(cls, path: Path) -> RunDir:
        """Open the run directory of a run that has begun. Raises RunDirError if it holds none."""
        if not (path / RUN_FILE).is_file():
            raise RunDirError(f"{path} holds no run (no {RUN_FILE})")
        check_folder(path, "the run directory")
        return cls(path)

    def save(self, info: RunInfo) -> None:
        """Write run.json, and the targets of metrics if there are any. Raises RunDirError."""
        _write(self.path / RUN_FILE, json.dumps(asdict(info), indent=2))
        if info.metrics_ports:
            labels = {"mission": info.mission_name, "run": info.run}
            targets = [
                {"targets": [f"127.0.0.1:{port}"], "labels": labels | {"robot": robot}}
                for robot, port in info.metrics_ports.items()
            ]
            _write(self.metrics_targets_path, json.dumps(targets, indent=2) + "\n")

    def info(self) -> RunInfo:
        """Read run.json. Raises RunDirError if it is damaged."""
        try:
            data: dict[str, Any] = json.loads((self.path / RUN_FILE).read_text(encoding="utf-8"))
            places = {
                robot: Place(place["address"], tuple(place["prefix"]))
                for robot, place in data["places"].items()
            }
            options: dict[str, Any] = {
                name: tuple(value) if isinstance(value, list) else value
                for name, value in data["options"].items()
            }
            found = {"options": RobotOptions(**options), "robots": tuple(data["robots"])}
            return RunInfo(**data | found | {"places": places})
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise RunDirError(f"{self.path / RUN_FILE} is damaged: {error}") from error

    def opened_output(self, path: Path) -> IO[bytes]:
        """Open a file for a process's output. Raises RunDirError."""
        try:
            return open(path, "ab", opener=private_opener)
        except OSError as error:
            raise _unwritable(path, error) from error

    def output_path(self, robot: str) -> Path:
        """The file with a robot's output."""
        return self.path / f"{robot}.out"

    def log_path(self, robot: str) -> Path:
        """The file with a robot's log."""
        return self.path / f"{robot}.log"

    def check_robot(self, robot: str) -> None:
        """Raise RunDirError if the run has no such robot."""
        known = self.members()
        if robot not in known:
            raise RunDirError(
                f"the run in {self.path} has no robot {robot!r}{nearest(robot, known)}"
            )

    def members(self) -> list[str]:
        """Return the robots of the run: those that it began with, and those that joined later."""
        return sorted({*self.info().robots, *self.robots()})

    # -- processes ------------------------------------------------------------------------

    def write_process(self, robot: str) -> None:
        """Record the identity of a robot's process, which calls this at its start.

        Raises OSError.
        """
        self._last_words(robot).unlink(missing_ok=True)
        path, identity = self.path / f"{robot}.process", identity_of_this_process()
        try:
            write_atomically(path, identity)
        except OSError:
            # On a full disk, the file of an earlier life can still be overwritten.
            if not _overwrite(path, identity):
                raise

    def mark_alive(self, robot: str) -> None:
        """Mark the robot as alive, for health checks.

        Called about once a second while its loop turns. If its process file is missing, it is
        written now.
        """
        path = self.path / f"{robot}.process"
        with contextlib.suppress(OSError):
            try:
                os.utime(path)
            except FileNotFoundError:
                write_atomically(path, identity_of_this_process())

    @property
    def has_run(self) -> bool:
        """True if this directory holds a run, whose commands find robots by their files here."""
        return (self.path / RUN_FILE).is_file()

    def write_blocked(self, robot: str, text: str) -> None:
        """Write what blocks the robot's event loop now; an empty text removes the file."""
        path = self.path / f"{robot}.blocked"
        with contextlib.suppress(OSError):
            if text:
                write_atomically(path, text)
            else:
                path.unlink(missing_ok=True)

    def write_last_words(self, robot: str, text: str) -> None:
        """Write why the robot's process is about to end by itself."""
        with contextlib.suppress(OSError):
            write_atomically(self._last_words(robot), text)

    def last_words(self, robot: str) -> str:
        """Return why the robot's process ended by itself.

        Empty if it did not, or if it runs again.
        """
        with contextlib.suppress(OSError):
            if self.process(robot) is None:
                return self._last_words(robot).read_text(encoding="utf-8", errors="replace")
        return ""

    def _last_words(self, robot: str) -> Path:
        return self.path / f"{robot}.died"

    def blocked(self, robot: str) -> str:
        """Return what blocks the robot's event loop now; empty if nothing is known to block it."""
        with contextlib.suppress(OSError):
            if self.process(robot) is not None:
                return (self.path / f"{robot}.blocked").read_text(encoding="utf-8")
        return ""

    def blocked_robots(self) -> list[str]:
        """Return the robots with a note about what blocks, or blocked, their event loop."""
        return self._names_of("blocked")

    def died_robots(self) -> list[str]:
        """Return the robots whose processes have written last words."""
        return self._names_of("died")

    def alive_mark_ns(self, robot: str) -> int:
        """Return when the robot began or was last marked alive, in Unix time.

        0 if it has not begun.
        """
        with contextlib.suppress(OSError):
            return (self.path / f"{robot}.process").stat().st_mtime_ns
        return 0

    def process(self, robot: str) -> psutil.Process | None:
        """Return the robot's process if it runs, else None."""
        return process_in(self.path / f"{robot}.process")

    def living(self) -> dict[str, psutil.Process]:
        """Return the processes of the robots that run, by robot."""
        found = {robot: self.process(robot) for robot in self.robots()}
        return {robot: process for robot, process in found.items() if process is not None}

    # -- what happened --------------------------------------------------------------------

    def write_deaths(self, deaths: Sequence[MajorFault], now_us: int) -> None:
        """Write the times of deaths.

        Only the launcher of the robots calls this: its times count.
        """
        from mrbt_mesh.recording.messages import pack_death

        rows = [pack_death(fault, now_us) for fault in deaths if not fault.is_older]
        written = {"written_unix_s": time.time(), "clock": clock_id(), "written_us": now_us}
        text = json.dumps(written | {"deaths": rows})
        with contextlib.suppress(OSError):
            write_atomically(self.path / DEATHS_FILE, text)

    def deaths(self, now_us: int) -> list[tuple[str, Incarnation, DeathTimes]]:
        """Return the deaths that were last written, with times on this machine's clock.

        May be empty.
        """
        from mrbt_mesh.recording.messages import unpack_death

        try:
            data = json.loads((self.path / DEATHS_FILE).read_text(encoding="utf-8"))
            written_us = now_us - round((time.time() - data["written_unix_s"]) * 1e6)
            if is_this_clock(data.get("clock")):
                written_us = int(data["written_us"])
            return [unpack_death(row, written_us) for row in data["deaths"]]
        except (OSError, ValueError, KeyError, TypeError):
            return []

    def robots(self) -> list[str]:
        """Return the robots that ever had a process in this run."""
        return self._names_of("process")

    def _names_of(self, suffix: str) -> list[str]:
        """Return the sorted names of the files with this suffix, without it."""
        with contextlib.suppress(OSError):
            parts = (name.rpartition(".") for name in os.listdir(self.path))
            return sorted(name for name, _, found in parts if found == suffix)
        return []

    def summary(self) -> dict[str, Any] | None:
        """Return the summary of a run that has ended, else None."""
        try:
            text = (self.path / SUMMARY_FILE).read_text(encoding="utf-8")
            data: dict[str, Any] = json.loads(text)
        except (OSError, ValueError):
            return None
        return data

    def write_first_summary(self, summary: Mapping[str, Any]) -> bool:
        """Write summary.json unless this run already has one; return True if it was written.

        Raises RunDirError.
        """
        path = self.path / SUMMARY_FILE
        temporary = path.with_name(f".{path.name}.{os.getpid()}.first")
        try:
            _write(temporary, _summary_text(summary))
            # Some USB sticks and network disks have no hard links: there the file is renamed.
            with contextlib.suppress(OSError):
                os.link(temporary, path)
                return True
            if self.summary() is not None:
                return False
            temporary.replace(path)  # a damaged one may be there
        except OSError as error:
            raise _unwritable(path, error) from error
        finally:
            temporary.unlink(missing_ok=True)
        return True

    def remove_summary(self) -> None:
        """Remove the summary and its signature, because the run continues. Raises RunDirError."""
        for name in (SUMMARY_FILE, SIGNATURE_FILE):
            try:
                (self.path / name).unlink(missing_ok=True)
            except OSError as error:
                raise _unwritable(self.path / name, error, "removed") from error

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write summary.json. Raises RunDirError."""
        _write(self.path / SUMMARY_FILE, _summary_text(summary))
