"""What a user does first, by the installed command alone: `python tour.py MRBT FOLDER [robot]`.

A team of real processes works, a robot is killed and replaced, the whole team is killed and goes on
from its journals, and the mission is simulated, unless `robot`: then that
is refused with the remedy. FOLDER is empty, or holds a mission in `town`.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

LIMIT_S = 120.0
POLL_S = 0.1


class Tour:
    """The steps, one after the other; the first that goes wrong ends it."""

    def __init__(self, mrbt: str, folder: Path) -> None:
        self.mrbt, self.folder = mrbt, folder
        self.run_dir, self.hold = folder / "run", folder / "hold"
        os.environ["MRBT_HOLD"] = str(self.hold)
        self.mission = folder / "town" / "mission.yaml"

    def go(self, is_robot: bool) -> None:
        if not self.mission.exists():
            self.ask("new", str(self.mission.parent), "--example", "vehicle_repair")
        self.hold.write_text("replace_hw\n")
        up = self.up("--detach")
        assert up.wait(LIMIT_S) == 0, "mrbt up --detach"
        victim = self.wait_for(lambda: self.worker("replace_hw"), "a robot works on replace_hw")
        self.ask("kill", victim)
        other = self.wait_for(
            lambda: {self.worker("replace_hw")} - {victim, None}, "another robot works on it"
        )
        print(f"{victim} was killed, {other.pop()} has taken over")
        for path in self.run_dir.glob("*.process"):
            if path.stem != victim:
                os.kill(json.loads(path.read_text())["pid"], signal.SIGKILL)
        self.hold.write_text("")
        up = self.up("--continue", "--headless", "--json", "--timeout", str(LIMIT_S))
        assert up.wait(2 * LIMIT_S) == 0, "mrbt up --continue"
        assert self.told("status", "--run-dir", str(self.run_dir))["result"] == "success"
        print("the whole team was killed, and has gone on from its journals")
        # Of robots that were killed the end of a recording may be missing: a gap, no contradiction.
        report = self.ask("recording", "verify", str(self.run_dir), status=(0, 1))
        assert "contradictions" not in report or " 0 contradictions" in report, report
        print("nothing in its recordings contradicts the rest")
        if is_robot:
            said = self.ask("sim", "run", str(self.mission), status=(2,))
            assert "needs the extra 'planner': pip install 'mrbt-mesh[planner]'" in said, said
            print("what a robot has not is said")
            return
        assert self.told("sim", "run", str(self.mission))["result"] == "success"
        print("the mission succeeds in the simulator")

    def up(self, *options: str) -> "subprocess.Popen[bytes]":
        words = ("up", str(self.mission), "--run-dir", str(self.run_dir), "--speed", "10")
        return subprocess.Popen([self.mrbt, *words, *options])

    def worker(self, local_task: str) -> "str | None":
        """The robot that works on a local task, by what `mrbt status` says."""
        robots = self.told("status", "--run-dir", str(self.run_dir))["robots"]
        for robot, row in robots.items():
            if row["state"] == "alive" and (row.get("local_task") or "").startswith(local_task):
                return str(robot)
        return None

    def ask(self, *words: str, status: "tuple[int, ...]" = (0,)) -> str:
        """What a command prints that ends with one of these statuses."""
        done = subprocess.run(
            [self.mrbt, *words], capture_output=True, timeout=LIMIT_S, check=False
        )
        said, problems = (text.decode(errors="replace") for text in (done.stdout, done.stderr))
        assert done.returncode in status, (words, said + problems)
        return said if done.returncode != 2 else problems

    def told(self, *words: str) -> Any:
        return json.loads(self.ask(*words, "--json"))

    def wait_for(self, look: Callable[[], Any], what: str) -> Any:
        for _ in range(int(LIMIT_S / POLL_S)):
            if found := look():
                return found
            time.sleep(POLL_S)
        raise AssertionError(f"never came true: {what}")


if __name__ == "__main__":
    Tour(sys.argv[1], Path(sys.argv[2])).go(sys.argv[3:] == ["robot"])
