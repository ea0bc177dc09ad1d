"""One `mrbt up` in a folder of its own, as the benchmarks drive it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import psutil

from benchmarks.report import ROOT
from mrbt_mesh.drills.physical import read_events
from mrbt_mesh.runtime.driver import EVENTS_FILE
from mrbt_mesh.runtime.run_dir import RunDir

REPAIR = ROOT / "examples" / "vehicle_repair" / "mission.yaml"
WAIT_S, LOOK_S = 60.0, 0.005

_Found = TypeVar("_Found")


def until(look: Callable[[], _Found | None], timeout_s: float = WAIT_S) -> _Found | None:
    """What `look` finds, as soon as it finds something; None: not in time."""
    deadline_s = time.monotonic() + timeout_s
    while not (found := look()) and time.monotonic() < deadline_s:
        time.sleep(LOOK_S)
    return found or None


def cpu_s(processes: Iterable[psutil.Process]) -> float:
    """Processor time that these processes have used."""
    return sum(sum(process.cpu_times()[:2]) for process in processes)


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
        """Wait until that many robots live, or all is over already; raises TimeoutError."""
        if not until(lambda: len(self.processes()) >= count or self.process.poll() is not None):
            raise TimeoutError(f"no {count} robots in {self.folder}")

    def wait_for(self, local_task: str, event: str, **more: Any) -> dict[str, Any]:
        """Wait for a physical event; raises TimeoutError."""
        wanted = {"local_task": local_task, "event": event, **more}.items()
        found = until(lambda: next((e for e in self.events() if wanted <= e.items()), None))
        if found is None:
            raise TimeoutError(f"no {event} of {local_task} in {self.folder}")
        return found

    def kill(self) -> list[str]:
        """SIGKILL for all robots at once; returns the killed robots, once all are dead."""
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
def team(write_mission: Callable[[Path], Path], *options: str) -> Iterator[Run]:
    """A team that runs; its mission is written into a folder of its own."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        run = Run(Path(folder), write_mission(Path(folder)), *options)
        try:
            yield run
        finally:
            run.stop()


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
