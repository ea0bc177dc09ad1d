"""Teams of real processes over Zenoh on loopback, each in a folder of its own.

Nothing in such a test may depend on how fast the machine is: a test waits for what robots did
(`wait_for_event`), for what `mrbt up` has seen (`wait_for_line`), and holds a robot or a task
(`hold`) until it has seen what it waits for. The times below only end a test that hangs.
"""

from __future__ import annotations

import contextlib
import copy
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from mrbt_mesh.drills.physical import read_events
from mrbt_mesh.runtime.run_dir import write_atomically
from tests.support.paths import ROOT, mission_file

REPAIR = mission_file("vehicle_repair")
EXPLORE = mission_file("explore")
# A wait in vain ends with the robots' logs, long before pytest-timeout ends the test without.
WAIT_S = 180.0
RUN_S = 500.0
TEST_TIMEOUT_S = 600
POLL_S = 0.02


class Team:
    """One `mrbt up` and the commands that a second terminal would give."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.run_dir = folder / "run"
        self._hold = folder / "hold"
        self.environment = os.environ | {
            "MRBT_STATE_DIR": str(folder),
            "MRBT_HOLD": str(self._hold),
            "COLUMNS": "120",
        }
        self._up: subprocess.Popen[str] | None = None
        self._started: list[subprocess.Popen[str]] = []
        self._held: set[str] = set()
        self._tick = threading.Event()

    def at(self, **network: object) -> Team:
        """The same team for commands that find it on a network: `router="..."` is MRBT_ROUTER."""
        there = copy.copy(self)
        there.environment = self.environment | {
            f"MRBT_{name.upper()}": str(value) for name, value in network.items()
        }
        return there

    # -- commands -------------------------------------------------------------------------

    def command(self, *arguments: str, given: str = "") -> subprocess.CompletedProcess[str]:
        """Run `mrbt ...` to its end, with this as its standard input."""
        return subprocess.run(
            [sys.executable, "-m", "mrbt_mesh", *arguments],
            env=self.environment,
            cwd=ROOT,
            input=given,
            capture_output=True,
            text=True,
            timeout=RUN_S,
            check=False,
        )

    def mrbt(self, *arguments: str) -> str:
        """Run `mrbt ...`, which must succeed; returns what it printed."""
        done = self.command(*arguments)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def up(
        self, mission: Path = REPAIR, *options: str, speed: float = 10, timeout_s: float = RUN_S
    ) -> None:
        """Start a team in the background. Its robots work fast: `hold` what a test must see."""
        command = [sys.executable, "-m", "mrbt_mesh", "up", str(mission), "--headless"]
        command += ["--run-dir", str(self.run_dir), "--timeout", str(timeout_s)]
        command += ["--speed", str(speed)]
        with (self.folder / "up.out").open("w") as output:
            self._up = subprocess.Popen(
                [*command, *options],
                env=self.environment,
                cwd=ROOT,
                stdout=output,
                stderr=subprocess.PIPE,
                text=True,
            )

    def agent(self, mission: Path, robot: str, *options: str) -> subprocess.Popen[str]:
        """Start one agent by hand, without a launcher; without keys, `--insecure`."""
        has_keys = "--keys" in options or "MRBT_KEYS" in self.environment
        secure = () if has_keys else ("--insecure",)
        words = ("agent", "--mission", str(mission), "--robot", robot, *secure, *options)
        return self.start(*words)

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

    def serve(self, *options: str) -> tuple[subprocess.Popen[str], str]:
        """A server of the team's API, and its address."""
        process = self.start("serve", "--run-dir", str(self.run_dir), "--json", *options)
        assert process.stdout is not None
        lines = "".join(iter(process.stdout.readline, "}\n"))
        return process, json.loads(lines + "}")["serve"]

    def interrupt(self) -> None:
        """Stop `up`, as Ctrl-C does."""
        assert self._up is not None
        self._up.send_signal(signal.SIGINT)

    def signal_launcher(self, number: signal.Signals) -> None:
        """Signal `up` itself, and none of its robots."""
        assert self._up is not None
        self._up.send_signal(number)

    def end(self) -> tuple[int, dict[str, Any]]:
        """Wait for `up` to end; returns exit status and summary."""
        assert self._up is not None
        _, problems = self._up.communicate(timeout=RUN_S)
        assert self._up.returncode != 2, problems
        return self._up.returncode, json.loads((self.run_dir / "summary.json").read_text())

    def status(self) -> dict[str, Any]:
        """`mrbt status --json`."""
        data: dict[str, Any] = json.loads(self.mrbt("status", "--json"))
        return data

    # -- holding --------------------------------------------------------------------------

    def hold(self, *names: str) -> None:
        """From now on these robots, local or global tasks start work but do not get on with it."""
        self._held |= set(names)
        self._write_hold()

    def release(self, *names: str) -> None:
        """Let these go on, or all if none is named."""
        self._held = self._held - set(names) if names else set()
        self._write_hold()

    def _write_hold(self) -> None:
        write_atomically(self._hold, "".join(f"{name}\n" for name in sorted(self._held)))

    # -- robots ---------------------------------------------------------------------------

    def robots(self) -> list[str]:
        """Robots that ever had a process in this run."""
        return sorted(path.stem for path in self.run_dir.glob("*.process"))

    def pid(self, robot: str) -> int:
        """The pid of a robot's process."""
        return int(json.loads((self.run_dir / f"{robot}.process").read_text())["pid"])

    def signal(self, robot: str, number: signal.Signals) -> None:
        """Signal a robot at once: a command would take some time to start."""
        os.kill(self.pid(robot), number)

    def kill_all(self) -> None:
        """Kill all robots of the run."""
        for robot in self.robots():
            self.signal(robot, signal.SIGKILL)

    # -- what can be seen -----------------------------------------------------------------

    def events(self) -> list[dict[str, Any]]:
        """The physical events so far."""
        return read_events(self.run_dir / "events.jsonl")

    def log(self, robot: str) -> list[dict[str, Any]]:
        """A robot's log."""
        return read_events(self.run_dir / f"{robot}.log")

    def lines(self) -> str:
        """What `mrbt up` has printed so far: what it has seen of the team."""
        return (self.folder / "up.out").read_text()

    def wait_until(self, holds: Callable[[], Any], what: str) -> Any:
        """Poll until `holds()` is true and return its value."""
        for _ in range(int(WAIT_S / POLL_S)):
            found = holds()
            if found:
                return found
            self._tick.wait(POLL_S)
        raise AssertionError(f"never came true: {what}\n{self.logs()}")

    def wait_for_events(
        self, count: int, local_task: str, event: str = "start", **more: Any
    ) -> list[dict[str, Any]]:
        """Wait for `count` physical events of a kind; returns all of that kind."""
        wanted = {"local_task": local_task, "event": event, **more}

        def found() -> list[dict[str, Any]] | None:
            lines = [e for e in self.events() if all(e[k] == v for k, v in wanted.items())]
            return lines if len(lines) >= count else None

        result: list[dict[str, Any]] = self.wait_until(found, f"{count} times {wanted}")
        return result

    def wait_for_event(self, local_task: str, event: str = "start", **more: Any) -> dict[str, Any]:
        """Wait for the first physical event of a kind."""
        return self.wait_for_events(1, local_task, event, **more)[0]

    def wait_for_line(self, text: str) -> None:
        """Wait until `mrbt up` has seen, and said, something."""
        self.wait_until(lambda: text in self.lines(), f"mrbt up says {text!r}")

    def wait_for_work(self, event: dict[str, Any]) -> dict[str, Any]:
        """Wait until `mrbt up` knows what the robot of a start event works on; the event."""
        arguments = f"({','.join(event['args'])})" if event["args"] else ""
        work = f"{event['local_task']}{arguments} for {event['global_task']}"
        self.wait_for_line(f"{event['robot']}: {work}")
        return event

    def wait_for_replacement(self, event: dict[str, Any]) -> dict[str, Any]:
        """Wait until another robot starts what one had started; its first event."""

        def found() -> dict[str, Any] | None:
            for line in self.events():
                if line["activation"] == event["activation"] and line["robot"] != event["robot"]:
                    return line
            return None

        result: dict[str, Any] = self.wait_until(found, f"another robot does {event}")
        return result

    def logs(self) -> str:
        """What `mrbt up` said and the ends of all logs, for a failure message."""
        paths = [self.folder / "up.out", *sorted(self.run_dir.glob("*.log"))]
        paths += sorted(self.run_dir.glob("*.out"))
        found = [path for path in paths if path.exists()]
        return "\n".join(f"== {p.name}\n" + p.read_text()[-1500:] for p in found)

    def running(self) -> list[psutil.Process]:
        """Robots of this test that run, also those started by hand."""
        # What was seen of each when it was found: one that is killed now is a zombie for a while.
        return [
            p
            for p in self._mine()
            if "agent" in p.info["cmdline"] or p.info["name"].startswith("mrbt ")
        ]

    def fork_servers(self) -> list[psutil.Process]:
        """The processes that robots were forked from, and that still run."""
        forked = {process.pid for process in self.running()}
        mine = [p for p in self._mine() if "mrbt_mesh.cli.fork_server" in p.info["cmdline"]]
        return [process for process in mine if process.pid not in forked]

    def _mine(self) -> list[psutil.Process]:
        found = psutil.process_iter(["cmdline", "name"])
        return [p for p in found if str(self.folder) in " ".join(p.info["cmdline"] or ())]

    def __enter__(self) -> Team:
        return self

    def __exit__(self, *error: object) -> None:
        self.clean()

    def clean(self) -> None:
        """End every process that this team started."""
        for started in (*self._started, *([self._up] if self._up else [])):
            if started.poll() is None:
                started.kill()
            if started.stderr is not None and not started.stderr.closed:
                started.communicate()
        for process in self.running():
            with contextlib.suppress(psutil.Error):
                process.kill()
