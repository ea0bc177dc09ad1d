"""A team under faults, judged from what its clients were answered and what its robots did.

    python -m benchmarks.history [--minutes 60] [--rate 5] [--seed 1] [--commands 200] [--json FILE]

Six robots with keys live in network namespaces of their own (root, Linux). Two servers (`mrbt
serve`) take jobs from several clients over HTTP: new ones, the same again, another one under the
same id, and changes of priority, holds, releases and cancellations. Meanwhile robots are killed and
start again, are frozen and cut off, the whole team is killed and continued, and short commands
(`mrbt status`, `submit`, `job`, `jobs`) run beside them. `benchmarks.history_rules` judges the
history. The memory of every process is sampled; `growth` is the slope after the first ten minutes,
in MB an hour. The exit status is 1 if a rule is broken, a request is not answered, or a short
command fails without a reason.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import anyio
import httpx2
import psutil

from benchmarks.history_rules import (
    ANSWER_S,
    CANCEL,
    DONE,
    ENDED,
    HOLD,
    LONG_AGO,
    PRIORITY,
    REFUSED,
    RELEASE,
    SUBMIT,
    UNKNOWN,
    Fault,
    History,
    Operation,
    Read,
    Work,
    violations,
)
from benchmarks.report import run_program, say
from mrbt_mesh.drills.namespaces import Namespaces, available

ROBOTS = ("R1", "R2", "R3", "R4", "R5", "R6")
PROGRAM = '''
import json, os, time
from pathlib import Path

import anyio
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()
FOLDER = Path(__file__).parent / "work"


def note(file, **what):
    """One write per line: a kill leaves whole lines."""
    at_s = time.clock_gettime(time.CLOCK_BOOTTIME)
    os.write(file, (json.dumps({"at_s": at_s, **what}) + "\\n").encode())


@robot.local_task("*")
async def do(task: TaskContext, number: str) -> None:
    file = os.open(FOLDER / f"{task.robot}.jsonl", os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    work = f"{os.getpid()}.{time.monotonic_ns()}"
    end = "cancelled"
    note(file, work=work, event="begin", content=int(number))
    try:
        for _ in range(6):
            await anyio.sleep(0.05)
            note(file, work=work, event="step")
        end = "success"
    finally:
        note(file, work=work, event=end)
        os.close(file)
'''
MISSION = """
mission: history
program: robot.py
ends: never
local_tasks:
  plain: {parameters: [number]}
  dose: {parameters: [number]}
robot_types: {arm: {capabilities: {plain: 1, dose: 1}}}
robots: {R1: arm, R2: arm, R3: arm, R4: arm, R5: arm, R6: arm}
global_tasks:
  do: {parameters: [number], needs: {plain($number): {}}}
  dose: {parameters: [number], needs: {dose($number): {}}, exclusive: true, in_doubt: fail}
jobs:
  plain: {parameters: {number: {min: 1, max: 9000000}}, tree: do($number)}
  once: {parameters: {number: {min: 1, max: 9000000}}, tree: dose($number)}
tree: {Jobs: all}
"""
PORT = 7_500
# Contents from here on are those of a second job under an id that another one has.
OTHER = 1_000_000
SETTLE_S = 60.0
SAMPLE_S = 10.0
WARM_S = 600.0
# For so long a job that is not due is left alone before it is read, and cancelled: or the memory
# would grow with the jobs that are open.
PARKED_S = 300.0
CLIENTS = 4


def now_s() -> float:
    """A clock that all processes of this machine share."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class Team:
    """Six agents, each in its namespace, and what is done to them."""

    def __init__(self, folder: Path, network: Namespaces) -> None:
        self.folder, self.network = folder, network
        self.faults: list[Fault] = []
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self.starts: Counter[str] = Counter()
        (folder / "work").mkdir()
        (folder / "robot.py").write_text(PROGRAM)
        self.mission = folder / "mission.yaml"
        self.mission.write_text(MISSION)
        self.keys = folder / "keys"
        mrbt = [sys.executable, "-m", "mrbt_mesh"]
        subprocess.run(
            [*mrbt, "keys", "init", str(self.keys), "--robots", ",".join(ROBOTS)],
            check=True,
            capture_output=True,
        )
        self.endpoints = {robot: f"tcp/{network.address(robot)}:{PORT}" for robot in ROBOTS}
        # What `mrbt serve` and the short commands need.
        self.environment = os.environ | {
            "MRBT_STATE_DIR": str(folder / "state"),
            "MRBT_MISSION": str(self.mission),
            "MRBT_KEYS": str(self.keys),
            "MRBT_CONNECT": ",".join(self.endpoints.values()),
        }

    def start(self, robot: str) -> None:
        """Start a robot's process; it resumes from its journal."""
        before = [other for other in ROBOTS if other < robot]
        command = [*self.network.command_prefix(robot), sys.executable, "-m", "mrbt_mesh", "agent"]
        command += ["--mission", str(self.mission), "--keys", str(self.keys), "--robot", robot]
        command += ["--run-dir", str(self.folder / "run"), "--listen", self.endpoints[robot]]
        if before:
            command += ["--connect", ",".join(self.endpoints[other] for other in before)]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("MRBT_")}
        environment["MRBT_STATE_DIR"] = str(self.folder / "state")
        self.starts[robot] += 1
        output = (self.folder / f"{robot}.out").open("ab")
        self.processes[robot] = subprocess.Popen(
            command, stdout=output, stderr=output, env=environment
        )
        output.close()

    def living(self) -> list[str]:
        """Robots whose process runs, sorted."""
        return sorted(r for r, process in self.processes.items() if process.poll() is None)

    def kill(self, robot: str) -> None:
        """SIGKILL; returns once the process is gone."""
        self.processes[robot].kill()
        self.processes[robot].wait()
        self.faults.append(Fault("kill", robot, now_s(), now_s()))

    @contextmanager
    def frozen(self, robot: str) -> Iterator[None]:
        """SIGSTOP, and SIGCONT at the end."""
        begun_s = now_s()
        self.processes[robot].send_signal(signal.SIGSTOP)
        try:
            yield
        finally:
            with contextlib.suppress(ProcessLookupError):
                self.processes[robot].send_signal(signal.SIGCONT)
            self.faults.append(Fault("freeze", robot, begun_s, now_s()))

    @contextmanager
    def cut_off(self, robots: Sequence[str]) -> Iterator[None]:
        """A partition between these robots and all others."""
        begun_s = now_s()
        self.network.partition(robots, [robot for robot in ROBOTS if robot not in robots])
        try:
            yield
        finally:
            self.network.heal()
            self.faults += [Fault("cut", robot, begun_s, now_s()) for robot in robots]

    def works(self) -> list[Work]:
        """What robots did, by the files that their program wrote."""
        found: list[Work] = []
        for robot in ROBOTS:
            path = self.folder / "work" / f"{robot}.jsonl"
            lines = path.read_text().splitlines() if path.exists() else []
            events: dict[str, list[dict[str, Any]]] = defaultdict(list)
            for line in map(json.loads, lines):
                events[line["work"]].append(line)
            for each in events.values():
                end = each[-1]["event"] if each[-1]["event"] in ("success", "cancelled") else ""
                found.append(
                    Work(robot, each[0]["content"], each[0]["at_s"], each[-1]["at_s"], end)
                )
        return found


class Server:
    """One `mrbt serve`, which is never started again: it must find the team by itself."""

    def __init__(self, team: Team, name: str) -> None:
        self.name = name
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.url = f"http://127.0.0.1:{port}"
        with (team.folder / f"{name}.out").open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "mrbt_mesh", "serve", "--port", str(port)],
                stdout=output,
                stderr=output,
                env=team.environment,
            )

    async def wait_until_it_answers(self) -> None:
        """Raises TimeoutError."""
        with anyio.fail_after(60):
            while True:
                with contextlib.suppress(httpx2.HTTPError):
                    async with _http(ANSWER_S) as http:
                        await http.get(f"{self.url}/v1/status")
                    return
                await anyio.sleep(0.2)


@dataclass
class Memory:
    """Resident memory of processes over time: name -> (seconds since the begin, MB)."""

    samples: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    def take(self, name: str, pid: int, at_s: float) -> None:
        """Sample one process, if it lives."""
        with contextlib.suppress(psutil.Error):
            process = psutil.Process(pid)
            megabytes = process.memory_info().rss / 1e6
            self.samples.setdefault(name, []).append((at_s, megabytes))

    async def follow(self, team: Team, servers: Sequence[Server]) -> None:
        """Sample robots and servers until cancelled."""
        begun_s = now_s()
        while True:
            for robot, process in team.processes.items():
                self.take(f"{robot}.{team.starts[robot]}", process.pid, now_s() - begun_s)
            for server in servers:
                self.take(server.name, server.process.pid, now_s() - begun_s)
            await anyio.sleep(SAMPLE_S)

    def growth(self, warm_s: float) -> dict[str, dict[str, float]]:
        """Of each process that lived for five minutes after `warm_s`: its slope in MB an hour."""
        found = {}
        for name, samples in sorted(self.samples.items()):
            late = [each for each in samples if each[0] >= warm_s]
            if not late or late[-1][0] - late[0][0] < 300:
                continue
            mean_s = sum(at_s for at_s, _ in late) / len(late)
            mean_mb = sum(mb for _, mb in late) / len(late)
            spread = sum((at_s - mean_s) ** 2 for at_s, _ in late)
            slope = sum((at_s - mean_s) * (mb - mean_mb) for at_s, mb in late) / spread
            found[name] = {
                "first_mb": round(late[0][1], 1),
                "last_mb": round(late[-1][1], 1),
                "mb_an_hour": round(slope * 3_600, 1),
                "minutes": round((late[-1][0] - late[0][0]) / 60, 1),
            }
        return found


def _http(timeout_s: float) -> httpx2.AsyncClient:
    """A client that loads no certificates: that took longer than a question itself."""
    return httpx2.AsyncClient(timeout=timeout_s, verify=False)


class Clients:
    """What clients ask; every answer goes into the history."""

    def __init__(self, servers: Sequence[Server], history: History, draw: random.Random) -> None:
        self.servers, self.history, self.draw = servers, history, draw
        self.numbers = iter(range(1, OTHER))
        self.recent: list[tuple[str, int, str]] = []
        self.latency_s: list[float] = []
        self.until_s = 0.0

    async def request(
        self, client: str, server: Server, kind: str, job: str, value: int, body: dict[str, Any]
    ) -> str:
        """One POST: DONE, REFUSED or UNKNOWN."""
        path = "/v1/jobs" if kind == SUBMIT else f"/v1/jobs/{job}/{kind}"
        invoked_s = now_s()
        answered_s: float | None = None
        answer, text = UNKNOWN, ""
        try:
            async with _http(2 * ANSWER_S) as http:
                response = await http.post(server.url + path, json=body)
            answered_s = now_s()
            if response.status_code in (200, 201, 202):
                answer = DONE
            elif response.status_code in (404, 409, 422):
                answer, text = REFUSED, response.text[:200]
            elif response.status_code in (503, 504):
                text = response.text[:200]
            else:
                text = f"!HTTP {response.status_code}: {response.text[:200]}"
        except httpx2.TimeoutException:
            text = "no answer"
        except httpx2.HTTPError as error:
            answered_s, text = now_s(), f"!{type(error).__name__}: {error}"
        self.history.operations.append(
            Operation(client, kind, job, value, invoked_s, answered_s, answer, text)
        )
        if kind == SUBMIT and answer == DONE and answered_s is not None:
            self.latency_s.append(answered_s - invoked_s)
        return answer

    async def read(self, client: str, server: Server, job: str) -> Read | None:
        """What a server shows of a job; None: it does not answer."""
        invoked_s = now_s()
        with contextlib.suppress(httpx2.HTTPError):
            async with _http(ANSWER_S) as http:
                response = await http.get(f"{server.url}/v1/jobs/{job}")
            shown = response.json() if response.status_code == 200 else {}
            state, priority = shown.get("state", ""), shown.get("priority")
            if response.status_code == 404 and "has ended long ago" in response.text:
                state = LONG_AGO
            return Read(client, job, state, priority, invoked_s, now_s())
        return None

    def submission(self, kind: str, content: int, job: str, **more: Any) -> dict[str, Any]:
        """The body of a submission."""
        return {"id": job, "type": kind, "arguments": {"number": content}, **more}

    async def go_on(self, client: str, rate: float, duration_s: float) -> None:
        """Have one client hand in `rate` jobs a second on average, and wait for all answers."""
        self.until_s = now_s() + duration_s
        async with anyio.create_task_group() as group:
            while now_s() < self.until_s:
                await anyio.sleep(self.draw.expovariate(rate))
                group.start_soon(self.one, client)

    async def one(self, client: str) -> None:
        """A new job, and in some cases more about it or about an earlier one."""
        number = next(self.numbers)
        job, kind = f"job-{number}", "once" if number % 3 == 0 else "plain"
        if kind == "once":
            self.history.exclusive |= {number, number + OTHER}
        server, other = self.draw.sample(list(self.servers), 2)
        case = self.draw.random()
        body = self.submission(kind, number, job, priority=self.draw.randint(0, 5))
        if case < 0.08:
            # Two contents under one id, at the same time or one after the other.
            second = {**body, "arguments": {"number": number + OTHER}}
            async with anyio.create_task_group() as group:
                group.start_soon(self.request, client, server, SUBMIT, job, number, body)
                if case < 0.04:
                    await anyio.sleep(self.draw.uniform(0, 1.5))
                group.start_soon(
                    self.request, f"{client}'", other, SUBMIT, job, number + OTHER, second
                )
            return
        if case < 0.2:
            await self.parked(client, server, other, job, number, body)
            return
        await self.request(client, server, SUBMIT, job, number, body)
        self.recent.append((job, number, kind))
        if case < 0.3:
            await self.request(client, other, SUBMIT, job, number, body)
        elif case < 0.4:
            await anyio.sleep(self.draw.uniform(0, 1))
            await self.request(client, other, CANCEL, job, 0, {})
        elif case < 0.5:
            await self.request(client, server, HOLD, job, 0, {})
            await anyio.sleep(self.draw.uniform(0, 4))
            await self.until_answered(client, other, RELEASE, job)
        elif case < 0.55 and len(self.recent) > 200:
            # An id whose job has ended long ago, with another content.
            old, content, of_type = self.draw.choice(self.recent[:-100])
            changed = self.submission(of_type, content + OTHER, old)
            await self.request(client, server, SUBMIT, old, content + OTHER, changed)

    async def parked(
        self, client: str, server: Server, other: Server, job: str, number: int, body: Any
    ) -> None:
        """A job that is not due during the run: its fields are written by two clients at once."""
        later = {**body, "not_before": "PT12H"}
        self.history.parked.add(job)
        if await self.request(client, server, SUBMIT, job, number, later) != DONE:
            return

        async def write(name: str, at: Server) -> None:
            for _ in range(self.draw.randint(1, 4)):
                kind = self.draw.choice((PRIORITY, PRIORITY, HOLD, RELEASE))
                value = self.draw.randint(1, 90) if kind == PRIORITY else 0
                given = {"priority": value} if kind == PRIORITY else {}
                await self.request(name, at, kind, job, value, given)
                await anyio.sleep(self.draw.uniform(0, 0.5))

        async with anyio.create_task_group() as group:
            group.start_soon(write, client, server)
            group.start_soon(write, f"{client}'", other)
        if now_s() + PARKED_S > self.until_s:
            return
        await anyio.sleep(PARKED_S)
        for each in self.servers:
            while (read := await self.read(client, each, job)) is None:
                await anyio.sleep(1)
            self.history.quiet.setdefault(job, []).append(read)
        await self.until_answered(client, server, CANCEL, job)

    async def until_answered(self, client: str, server: Server, kind: str, job: str) -> None:
        """Ask until a server says whether it is done: a held job would stay held for ever."""
        for _ in range(60):
            if await self.request(client, server, kind, job, 0, {}) != UNKNOWN:
                return
            await anyio.sleep(1)


class Faults:
    """Kills, freezes and partitions, one after the other, and the team killed whole at times."""

    def __init__(self, team: Team, draw: random.Random, every_s: float, whole: int) -> None:
        self.team, self.draw, self.every_s, self.whole = team, draw, every_s, whole
        self.counts: Counter[str] = Counter()

    async def run(self, duration_s: float) -> None:
        """Go on for `duration_s`; each fault is healed before the next."""
        whole_at = [duration_s * (n + 1) / (self.whole + 1) for n in range(self.whole)]
        begun_s = now_s()
        while now_s() - begun_s < duration_s:
            await anyio.sleep(self.draw.expovariate(1 / self.every_s))
            if whole_at and now_s() - begun_s > whole_at[0]:
                whole_at.pop(0)
                await self.kill_all()
                continue
            robots = self.team.living()
            if len(robots) < 4:
                continue
            robot = self.draw.choice(robots)
            case = self.draw.choice(("kill", "kill", "freeze", "short freeze", "cut", "cut two"))
            self.counts[case] += 1
            if case == "kill":
                self.team.kill(robot)
                await anyio.sleep(self.draw.uniform(0.5, 5))
                self.team.start(robot)
            elif case in ("freeze", "short freeze"):
                with self.team.frozen(robot):
                    await anyio.sleep(self.draw.uniform(0.1, 6 if case == "freeze" else 0.9))
            else:
                chosen = self.draw.sample(ROBOTS, 1 if case == "cut" else 2)
                with self.team.cut_off(chosen):
                    await anyio.sleep(self.draw.uniform(1, 10))

    async def kill_all(self) -> None:
        """Kill every robot, and start all again."""
        self.counts["whole team"] += 1
        for robot in self.team.living():
            self.team.kill(robot)
        await anyio.sleep(1)
        for robot in ROBOTS:
            self.team.start(robot)


async def short_commands(
    team: Team,
    draw: random.Random,
    count: int,
    duration_s: float,
    history: History,
    found: list[dict[str, Any]],
) -> None:
    """`count` short-lived programs, each a client of its own."""
    begin_s = now_s()
    for number in range(count):
        due_s = begin_s + duration_s * number / count
        await anyio.sleep(max(0.0, due_s - now_s()))
        words = draw.choice(
            (
                ["status", "--json"],
                ["jobs", "--json"],
                ["submit", "plain", str(2 * OTHER + number), "--id", f"cli-{number}"],
                ["job", "hold", "job-1"],
            )
        )
        begun_s, done = now_s(), None
        with anyio.move_on_after(60) as scope:
            done = await anyio.run_process(
                [sys.executable, "-m", "mrbt_mesh", *words], check=False, env=team.environment
            )
        if scope.cancelled_caught:
            found.append({"command": words, "status": None, "took_s": 60.0, "text": "no end"})
        if words[0] == "submit":
            answer = DONE if done is not None and done.returncode == 0 else UNKNOWN
            given = words[-1], 2 * OTHER + number, begun_s, now_s(), answer
            history.operations.append(Operation(f"cli-{number}", SUBMIT, *given))
        if done is None:
            continue
        text = (done.stdout if words[0] == "status" else done.stderr).decode()[-300:]
        took_s = round(now_s() - begun_s, 2)
        found.append({"command": words, "status": done.returncode, "took_s": took_s, "text": text})


async def settle(clients: Clients, history: History) -> None:
    """Read all jobs until both servers show ends, or time is over."""
    left = list(dict.fromkeys(each.job for each in history.operations))
    deadline_s = now_s() + SETTLE_S
    while left:
        for job in left:
            reads = [await clients.read("end", server, job) for server in clients.servers]
            history.final[job] = [read for read in reads if read is not None]
        if now_s() > deadline_s:
            return
        left = [job for job in left if job not in history.parked and _is_open(history.final[job])]
        await anyio.sleep(1)


def _is_open(reads: Sequence[Read]) -> bool:
    return not reads or any(read.state not in (*ENDED, "held") for read in reads)


async def report(history: History, faults: Faults) -> None:
    """Show the progress every minute."""
    begun_s = now_s()
    while True:
        await anyio.sleep(60)
        asked = Counter(each.answer for each in history.operations)
        minutes = (now_s() - begun_s) / 60
        say(f"{minutes:.0f} min: {dict(asked)}, faults {dict(faults.counts)}")


async def run(
    team: Team, clients: Clients, faults: Faults, minutes: float, rate: float, commands: int
) -> tuple[list[dict[str, Any]], Memory]:
    """Have everything happen; returns what the short commands answered, and the memory."""
    for server in clients.servers:
        await server.wait_until_it_answers()
    duration_s, memory = minutes * 60, Memory()
    answers: list[dict[str, Any]] = []
    async with anyio.create_task_group() as beside:
        beside.start_soon(memory.follow, team, clients.servers)
        beside.start_soon(report, clients.history, faults)
        async with anyio.create_task_group() as group:
            for number in range(CLIENTS):
                group.start_soon(clients.go_on, f"client-{number}", rate / CLIENTS, duration_s)
            group.start_soon(faults.run, duration_s)
            if commands:
                draw = random.Random(commands)
                given = commands, duration_s, clients.history, answers
                group.start_soon(short_commands, team, draw, *given)
        beside.cancel_scope.cancel()
    team.network.heal()
    for robot in ROBOTS:
        if robot not in team.living():
            team.start(robot)
    await anyio.sleep(5)
    await settle(clients, clients.history)
    return answers, memory


def figures(
    history: History, clients: Clients, answers: Sequence[dict[str, Any]], memory: Memory
) -> dict[str, Any]:
    """What came of it."""
    broken = violations(history)
    took = sorted(clients.latency_s)
    states = Counter(reads[0].state for reads in history.final.values() if reads)
    bad = [
        each
        for each in answers
        if "Traceback" in each["text"]
        or (each["status"] not in (0, 1) and not each["text"].startswith("error: "))
    ]
    return {
        "operations": dict(Counter(f"{o.kind} {o.answer}" for o in history.operations)),
        "states": dict(states),
        "works": len(history.works),
        "acknowledged_ms": {
            "median": round(1_000 * took[len(took) // 2]) if took else None,
            "p99": round(1_000 * took[len(took) * 99 // 100]) if took else None,
        },
        "commands": {
            "count": len(answers),
            "failed": sum(each["status"] != 0 for each in answers),
            "without_reason": bad[:10],
        },
        "memory": memory.growth(WARM_S),
        "broken": {rule: len(found) for rule, found in broken.items()},
        "examples": {rule: found[:10] for rule, found in broken.items() if found},
    }


def measure(
    minutes: float = 60,
    rate: float = 5,
    seed: int = 1,
    commands: int = 200,
    fault_every: float = 8,
    whole: int = 6,
    folder: str = "",
) -> dict[str, Any]:
    """One run. `fault_every`: seconds between faults on average; `whole`: kills of the team;
    `folder`: where its files stay.
    """
    reason = available()
    if reason is not None:
        raise SystemExit(f"benchmarks.history: {reason}")
    draw, history = random.Random(seed), History()
    with contextlib.ExitStack() as stack:
        base = Path(folder or stack.enter_context(tempfile.TemporaryDirectory()))
        team = Team(base, stack.enter_context(Namespaces(ROBOTS, "history")))
        for robot in ROBOTS:
            team.start(robot)
        servers = []
        for name in ("server-1", "server-2"):
            servers.append(Server(team, name))
            stack.callback(servers[-1].process.terminate)
        clients = Clients(servers, history, draw)
        faults = Faults(team, random.Random(seed + 1), fault_every, whole)
        answers, memory = anyio.run(run, team, clients, faults, minutes, rate, commands)
        history.works, history.faults = team.works(), team.faults
        found = figures(history, clients, answers, memory) | {"faults": dict(faults.counts)}
        (base / "history.json").write_text(
            json.dumps({name: repr(getattr(history, name)) for name in history.__slots__})
        )
        for robot in team.living():
            team.kill(robot)
    return found


if __name__ == "__main__":
    shown = run_program(__doc__, measure)
    is_bad = any(shown["broken"].values()) or shown["commands"]["without_reason"]
    raise SystemExit(1 if is_bad else 0)
