"""One `mrbt up` in a folder of its own, as the benchmarks drive it."""

from __future__ import annotations

import json
import os
import platform
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import psutil

from benchmarks.report import write_json
from mrbt_mesh.drills.physical import read_events
from mrbt_mesh.runtime.driver import EVENTS_FILE
from mrbt_mesh.runtime.run_dir import RunDir

ROOT = Path(__file__).resolve().parents[1]
REPAIR = ROOT / "examples" / "vehicle_repair" / "mission.yaml"
WAIT_S = 60.0


class Run:
    """A team that runs; `stop` it at the end."""

    def __init__(self, folder: Path, mission: Path, *options: str) -> None:
        self.folder = folder / "run"
        self._events: list[dict[str, Any]] = []
        self._events_size = 0
        environment = os.environ | {"MRBT_STATE_DIR": str(folder)}
        command = [sys.executable, "-m", "mrbt_mesh", "up", str(mission)]
        command += ["--run-dir", str(self.folder), "--json", *options]
        self.process = subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, cwd=ROOT
        )

    def events(self) -> list[dict[str, Any]]:
        """All physical events so far. Asked again and again: it takes no time from the team."""
        path = self.folder / EVENTS_FILE
        size = path.stat().st_size if path.exists() else 0
        if size != self._events_size:
            self._events, self._events_size = read_events(path), size
        return self._events

    def processes(self) -> dict[str, psutil.Process]:
        """Robot -> its process, of those that live."""
        run_dir = RunDir(self.folder)
        found = {robot: run_dir.process(robot) for robot in run_dir.robots()}
        return {robot: process for robot, process in found.items() if process is not None}

    def wait_for_processes(self, count: int) -> None:
        """Wait until so many robots live, or all is over already; raises TimeoutError."""
        deadline = time.monotonic() + WAIT_S
        while len(self.processes()) < count and self.process.poll() is None:
            if time.monotonic() > deadline:
                raise TimeoutError(f"no {count} robots in {self.folder}")
            time.sleep(0.01)

    def wait_for(self, local_task: str, event: str, **more: Any) -> dict[str, Any]:
        """Wait for a physical event; raises TimeoutError."""
        deadline = time.monotonic() + WAIT_S
        while time.monotonic() < deadline:
            for line in self.events():
                wanted = {"local_task": local_task, "event": event, **more}
                if all(line[key] == value for key, value in wanted.items()):
                    return line
            time.sleep(0.005)
        raise TimeoutError(f"no {event} of {local_task} in {self.folder}")

    def kill(self) -> list[str]:
        """SIGKILL for all robots at once; returns who was killed, when all of them are gone."""
        found = self.processes()
        for process in found.values():
            try:
                os.kill(process.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        psutil.wait_procs(found.values(), timeout=WAIT_S)
        return sorted(found)

    def end(self) -> dict[str, Any]:
        """Wait until `up` has ended; returns its summary."""
        output, _ = self.process.communicate(timeout=2 * WAIT_S)
        summary: dict[str, Any] = json.loads(output)
        return summary

    def stop(self) -> None:
        """End the team."""
        self.kill()
        self.process.terminate()
        self.process.wait(timeout=30)


@contextmanager
def stranger(program: str, run_dir: Path, *options: str) -> Iterator[subprocess.Popen[str]]:
    """A program of this package that disturbs the team of a run; it has begun."""
    info = json.loads((run_dir / "run.json").read_text())
    command = [sys.executable, "-m", f"benchmarks.{program}", *options, info["options"]["team"]]
    process = subprocess.Popen(
        [*command, *info["endpoints"].values()],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
    finally:
        process.kill()
        process.communicate()


def machine() -> str:
    """What the figures were measured on."""
    system = f"{platform.system()}, Python {platform.python_version()}"
    return f"{os.cpu_count()} cores, {platform.machine()}, {system}"


def versions() -> dict[str, str]:
    """Version of each package that figures depend on, of those that are installed."""
    found = {}
    for package in ("ortools", "numpy", "scipy", "py_trees"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def tell(result: Mapping[str, Any], file: Path | None) -> None:
    """The figures as JSON on stdout, and in a file if one is named."""
    sys.stdout.write(json.dumps(result, indent=2) + "\n")
    write_json(result, file)


def say(text: str) -> None:
    """A line for people."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
