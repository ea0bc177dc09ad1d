"""Teams of real processes over Zenoh on loopback, each in a folder of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

ROOT = Path(__file__).resolve().parents[2]
REPAIR = ROOT / "examples" / "vehicle_repair" / "mission.yaml"
WAIT_S = 60.0


class Team:
    """One `mrbt up` and the commands that a second terminal would give."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run_dir = folder / "run"
        self.environment = os.environ | {"MRBT_STATE_DIR": str(folder), "COLUMNS": "120"}
        self._up: subprocess.Popen[str] | None = None
        self._started: list[subprocess.Popen[str]] = []
        self._tick = threading.Event()

    def command(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run `mrbt ...` to its end."""
        return subprocess.run(
            [sys.executable, "-m", "mrbt_mesh", *arguments],
            env=self.environment,
            cwd=ROOT,
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )

    def mrbt(self, *arguments: str) -> str:
        """Run `mrbt ...`, which must succeed; returns what it printed."""
        done = self.command(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def up(self, mission: Path = REPAIR, *options: str) -> None:
        """Start a team in the background."""
        command = [sys.executable, "-m", "mrbt_mesh", "up", str(mission), "--json"]
        command += ["--run-dir", str(self.run_dir), "--timeout", str(WAIT_S), *options]
        self._up = subprocess.Popen(
            command,
            env=self.environment,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def agent(self, mission: Path, robot: str, *options: str) -> subprocess.Popen[str]:
        """Start one agent by hand, without a launcher."""
        return self.start("agent", "--mission", str(mission), "--robot", robot, *options)

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start `mrbt ...` in the background."""
        process = subprocess.Popen(
            [sys.executable, "-m", "mrbt_mesh", *arguments],
            env=self.environment,
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._started.append(process)
        return process

    def end(self) -> tuple[int, dict[str, Any]]:
        """Wait for `up` to end; returns exit status and summary."""
        assert self._up is not None
        output, problems = self._up.communicate(timeout=2 * WAIT_S)
        assert self._up.returncode != 2, problems
        return self._up.returncode, json.loads(output)

    def robots(self) -> list[str]:
        """Robots that ever had a process in this run."""
        return sorted(path.stem for path in self.run_dir.glob("*.process"))

    def signal(self, robot: str, number: signal.Signals) -> None:
        """Signal a robot at once: `mrbt kill` takes half a second to start."""
        os.kill(json.loads((self.run_dir / f"{robot}.process").read_text())["pid"], number)

    def events(self) -> list[dict[str, Any]]:
        """The physical events so far, whole lines only."""
        return self._lines("events.jsonl")

    def _lines(self, name: str) -> list[dict[str, Any]]:
        path = self.run_dir / name
        if not path.exists():
            return []
        text = path.read_text()
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    def status(self) -> dict[str, Any]:
        """`mrbt status --json`."""
        data: dict[str, Any] = json.loads(self.mrbt("status", "--json"))
        return data

    def wait_until(self, holds: Callable[[], Any], what: str) -> Any:
        """Poll until `holds()` is true and return its value; fails after a minute."""
        for _ in range(int(WAIT_S / 0.02)):
            found = holds()
            if found:
                return found
            self._tick.wait(0.02)
        raise AssertionError(f"never came true: {what}\n{self.logs()}")

    def wait_for_event(self, local_task: str, event: str = "start", **more: Any) -> dict[str, Any]:
        """Wait for a physical event."""

        def found() -> dict[str, Any] | None:
            wanted = {"local_task": local_task, "event": event, **more}
            for line in self.events():
                if all(line[key] == value for key, value in wanted.items()):
                    return line
            return None

        result: dict[str, Any] = self.wait_until(found, f"{event} of {local_task} {more}")
        return result

    def log(self, robot: str) -> list[dict[str, Any]]:
        """A robot's log."""
        return self._lines(f"{robot}.log")

    def logs(self) -> str:
        """The ends of all logs, for a failure message."""
        paths = sorted(self.run_dir.glob("*.log")) + sorted(self.run_dir.glob("*.out"))
        return "\n".join(f"== {p.name}\n" + p.read_text()[-1500:] for p in paths)

    def clean(self) -> None:
        """End every process that this team started."""
        for path in self.run_dir.glob("*.process"):
            try:
                process = psutil.Process(json.loads(path.read_text())["pid"])
                if "mrbt_mesh" in process.cmdline():
                    process.kill()
            except psutil.Error:
                continue
        for started in (*self._started, *([self._up] if self._up else [])):
            if started.poll() is None:
                started.kill()
            if started.stderr is not None and not started.stderr.closed:
                started.communicate()


@pytest.fixture
def team(tmp_path: Path) -> Iterator[Team]:
    """A team that is ended whatever happens."""
    result = Team(tmp_path)
    try:
        yield result
    finally:
        result.clean()
