"""Servers and clients that are open go on hearing their team, and are heard by it."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
from pathlib import Path

import httpx2 as httpx
import pytest

from tests.support.paths import ROOT
from tests.support.team import WAIT_S, Team

MISSION = """
mission: lives
program: robot.py
ends: never
local_tasks: {a: {parameters: [n], work: 0.1}}
robot_types: {bot: {capabilities: {a: 1}}}
robots: {R1: bot, R2: bot, R3: bot}
global_tasks: {ga: {parameters: [n], needs: {a($n): {min: 1}}}}
jobs: {go: {parameters: {n: {min: 1, max: 100000}}, tree: ga($n)}}
tree: {Jobs: [go]}
"""
# With the bound lowered in the robots' processes, a few commands are as many as 256.
LIVES = 4
PROGRAM = f"""
import anyio
from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.membership import envelope

envelope.MAX_LIVES = {LIVES}
robot = RobotProgram()

@robot.local_task
async def a(task: TaskContext, n: int) -> None:
    await anyio.sleep(0.1)
"""
# Does a job for each line that it reads, and prints its state.
CLIENT = """
import sys
import anyio
from mrbt_mesh import connect

async def main():
    async with connect(sys.argv[1]) as team:
        while line := await anyio.to_thread.run_sync(sys.stdin.readline):
            job = await team.submit("go", line.strip(), job_id=f"client{line.strip()}")
            print((await job.done()).state, flush=True)

anyio.run(main)
"""


class Lines:
    """What a process prints, line by line."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.put(line)

    def until(self, text: str) -> str:
        """The next line with this text."""
        while text not in (line := self._lines.get(timeout=WAIT_S)):
            pass
        return line

    def write(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{text}\n")
        self.process.stdin.flush()


@pytest.fixture
def lives(team: Team, tmp_path: Path) -> Team:
    """A team that stays, which has no `up`."""
    (tmp_path / "mission.yaml").write_text(MISSION)
    (tmp_path / "robot.py").write_text(PROGRAM)
    up(team)
    return team


def up(team: Team, *options: str) -> None:
    mission = str(team.folder / "mission.yaml")
    team.mrbt("up", mission, "--detach", "--run-dir", str(team.run_dir), *options)


def served(team: Team) -> httpx.Client:
    """A client of a server of the team."""
    process = team.start("serve", "--port", "0", "--run-dir", str(team.run_dir), "--json")
    assert process.stdout is not None
    address = json.loads("".join(iter(process.stdout.readline, "}\n")) + "}")["serve"]
    return httpx.Client(base_url=address, timeout=WAIT_S)


def post(http: httpx.Client, number: int) -> int:
    job = {"type": "go", "arguments": {"n": number}, "id": f"served{number}"}
    return http.post("v1/jobs", json=job).status_code


def test_many_short_commands_lock_no_open_server_out(lives: Team) -> None:
    with served(lives) as http:
        assert post(http, 1) == 201
        for _ in range(LIVES + 2):
            lives.mrbt("status", "--run-dir", str(lives.run_dir))
        assert [post(http, 2), post(http, 3)] == [201, 201]
    assert "it has to take a later one" in str(lives.status()["refused"]), "it was forgotten once"


def test_open_programs_find_a_team_again_that_was_killed_and_continued(lives: Team) -> None:
    run = str(lives.run_dir)
    client = Lines(
        subprocess.Popen(
            [sys.executable, "-c", CLIENT, run],
            env=lives.environment,
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
    )
    followed = Lines(lives.start("jobs", "--follow", "--run-dir", run))
    try:
        with served(lives) as http:
            assert post(http, 1) == 201
            followed.until("served1")
            client.write("1")
            client.until("succeeded")
            lives.kill_all()
            up(lives, "--continue")
            lives.wait_until(lambda: post(http, 2) == 201, "the server has its job taken")
            followed.until("served2")
            client.write("2")
            client.until("succeeded")
            followed.until("client2")
    finally:
        client.process.kill()
        client.process.communicate()


def test_a_server_says_that_the_run_has_ended_until_it_is_continued(lives: Team) -> None:
    with served(lives) as http:
        lives.mrbt("down", "--run-dir", str(lives.run_dir))
        lives.wait_until(lambda: http.get("v1/status").json()["over"], "the server knows the end")
        status = http.get("v1/status").json()
        assert (status["result"], status["headline"][0]["level"]) == ("ended", "info")
        assert "event: over" in http.get("v1/events").text, "the whole stream has ended"
        up(lives, "--continue")

        def goes_on() -> bool:
            status = http.get("v1/status").json()
            alive = [robot["state"] for robot in status["robots"].values()].count("alive")
            return not status["over"] and alive == 3

        lives.wait_until(goes_on, "the server has found its robots again")
        assert post(http, 9) == 201
