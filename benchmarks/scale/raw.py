"""The cost of a team's messages at rest with raw Zenoh and asyncio: the least a robot can use.

    python -m benchmarks.scale.raw [--sizes 6 24 64] [--seconds 10] [--json FILE]

As many processes as the team has robots, with sessions, links and heartbeats as robots have them:
each process publishes a heartbeat's bytes to the same receivers as often as a robot does, and hands
each message that it receives over to its event loop, where it is counted and forgotten. Compare it
with the column "all at rest" of `python -m benchmarks.scale`, in one run on one machine.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import psutil
import zenoh
from zenoh.handlers import Callback

from benchmarks.report import ROOT, run_program, say
from benchmarks.scale.processes import REST_S, SETTLE_S, percent_of_a_core
from benchmarks.security import RUN, team_keys
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.envelope import Guard
from mrbt_mesh.core.membership.ring import Ring
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.membership.wire import Header, Heartbeat, SelfReport, write_heartbeat
from mrbt_mesh.runtime.launcher import free_endpoints
from mrbt_mesh.runtime.session_config import TransportConfig, open_session, session_config

PREFIX = "mrbt/raw"
READY_TIMEOUT_S = 120.0


def heartbeat(me: str, near: tuple[str, ...]) -> bytes:
    """A sealed heartbeat of a robot that relays the reports of its neighbours."""
    report = SelfReport(Incarnation(1, "0" * 8), 1_000, bytes(8), True, 2)
    relays = dict.fromkeys(near, report)
    beat = Heartbeat(report, False, bytes(8), (2, 2, 2, 2), 50, (), relays)
    data = write_heartbeat(beat, Header("0" * 16, "patrol", RUN, me))
    # Neighbours, one more robot, and the operator, who may watch.
    keys = team_keys(len(near) + 2)
    return Guard(keys[0], RUN, time.time_ns() // 1_000).seal(data, keys[0].members()[1:])


async def take_part(number: int, endpoints: list[str], seconds: float) -> None:
    """Be one robot for that long; print the number of messages received in a second."""
    names = [f"R{robot:03}" for robot in range(len(endpoints))]
    timing, me = Timing(), names[number]
    near = Ring(names, timing.reach).neighbours(me)
    others = [name for name in names if name != me]
    is_small = timing.all_are_neighbours(len(names))
    period_s = timing.of_team(len(names)).heartbeat_us / SECOND_US
    data, loop, heard = heartbeat(me, near), asyncio.get_running_loop(), [0]

    def count(_: str, message: bytes) -> None:
        heard[0] += bool(message)

    def on_sample(sample: zenoh.Sample) -> None:
        source = str(sample.key_expr).rpartition("/")[2]
        loop.call_soon_threadsafe(count, source, sample.payload.to_bytes())

    config = TransportConfig(
        "raw", me, (endpoints[number],), tuple(endpoints[:number]), robots=len(names)
    )
    session = open_session(session_config(config), config.listen)
    for key in ("beat/*", f"to/{me}/*"):
        session.declare_subscriber(f"{PREFIX}/{key}", Callback(on_sample, indirect=False))
    began_s = loop.time()
    for beat in range(round(seconds / period_s)):
        turn = others[(number + beat) % len(others)]
        places = ["beat"] if is_small else [*(f"to/{name}" for name in {*near, turn}), "watch"]
        for place in places:
            session.put(
                f"{PREFIX}/{place}/{me}",
                data,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.REAL_TIME,
                express=True,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        await asyncio.sleep(max(0, began_s + (beat + 1) * period_s - loop.time()))
    sys.stdout.write(f"{heard[0] / (loop.time() - began_s):.1f}\n")
    sys.stdout.flush()
    session.close()


@contextmanager
def team(robots: int, seconds: float) -> Iterator[list[subprocess.Popen[str]]]:
    """The processes of a team, which end by themselves after that long."""
    endpoints = json.dumps(free_endpoints(robots, "tcp"))
    command = [sys.executable, "-m", "benchmarks.scale.raw", "--robot"]
    processes = [
        subprocess.Popen(
            [*command, str(number), endpoints, str(seconds)],
            stdout=subprocess.PIPE,
            text=True,
            cwd=ROOT,
        )
        for number in range(robots)
    ]
    try:
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()


def measured(robots: int, seconds: float) -> dict[str, float]:
    """Processor time of a whole team, in percent of a core, and messages per robot and second."""
    # Processes start one after the other, so each lives long enough for all to be there.
    start_s = SETTLE_S + robots / 2
    with team(robots, start_s + seconds + SETTLE_S) as processes:
        time.sleep(start_s)
        percent = percent_of_a_core([psutil.Process(each.pid) for each in processes], seconds)
        rates = [float(p.communicate(timeout=READY_TIMEOUT_S)[0]) for p in processes]
    rate = round(sum(rates) / robots, 1)
    say(f"{robots} processes: {percent} % of a core, {rate} messages a second to each")
    return {"robots": robots, "cpu_percent": percent, "messages_per_s": rate}


def measure(sizes: Sequence[int] = (6, 24, 64), seconds: float = REST_S) -> dict[str, Any]:
    """Teams of these sizes."""
    return {"sizes": [measured(size, seconds) for size in sizes]}


if __name__ == "__main__":
    if sys.argv[1:2] == ["--robot"]:
        number, endpoints, lives_s = sys.argv[2:]
        asyncio.run(take_part(int(number), json.loads(endpoints), float(lives_s)))
    else:
        run_program(__doc__, measure)
