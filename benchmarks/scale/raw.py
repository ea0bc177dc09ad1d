"""What the messages of a team at rest cost with raw Zenoh and asyncio: the least a robot can use.

    python -m benchmarks.scale.raw [--sizes 6,24,64] [--seconds 10] [--json FILE]

As many processes as the team has robots, with sessions, links and heartbeats as robots have them:
each process publishes a heartbeat's bytes to the same receivers as often as a robot does, and hands
each message that it receives over to its event loop, where it is counted and forgotten. Compare it
with the column "all at rest" of `python -m benchmarks.scale`, in one run on one machine.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import psutil
import zenoh
from zenoh.handlers import Callback

from benchmarks.report import script_parser, write_json
from benchmarks.run import ROOT, machine, say
from benchmarks.scale.processes import REST_S, SETTLE_S
from benchmarks.security import RUN, team_keys
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.envelope import Guard
from mrbt_mesh.core.membership.ring import Ring
from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.membership.wire import Header, Heartbeat, SelfReport, write_heartbeat
from mrbt_mesh.runtime.launcher import free_endpoints
from mrbt_mesh.runtime.session_config import TransportConfig, open_session, session_config

SIZES = (6, 24, 64)
PREFIX = "mrbt/raw"
READY_TIMEOUT_S = 120.0


def names_of(robots: int) -> list[str]:
    """The robots of a team."""
    return [f"R{number:03}" for number in range(robots)]


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
    """Be one robot for so long; prints how many messages came in a second."""
    names, timing = names_of(len(endpoints)), Timing()
    me, near = names[number], Ring(names, timing.reach).neighbours(names[number])
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
    """The processes of a team, which end by themselves after so long."""
    endpoints = json.dumps(free_endpoints(robots, "tcp"))
    command = [sys.executable, "-m", "benchmarks.scale.raw", "--seconds", str(seconds)]
    processes = [
        subprocess.Popen(
            [*command, "--robot", str(number), "--endpoints", endpoints],
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


def measure(robots: int, rest_s: float) -> dict[str, float]:
    """Processor time of a whole team, in percent of a core, and messages per robot and second."""
    # Processes start one after the other, so each lives long enough for all to be there.
    start_s = SETTLE_S + robots / 2
    with team(robots, start_s + rest_s + SETTLE_S) as processes:
        time.sleep(start_s)
        watched = [psutil.Process(process.pid) for process in processes]
        before_s, began_s = _cpu_s(watched), time.monotonic()
        time.sleep(rest_s)
        spent_s, over_s = _cpu_s(watched) - before_s, time.monotonic() - began_s
        rates = [float(p.communicate(timeout=READY_TIMEOUT_S)[0]) for p in processes]
    return {
        "robots": robots,
        "cpu_percent": round(100 * spent_s / over_s, 1),
        "messages_per_s": round(sum(rates) / robots, 1),
    }


def _cpu_s(processes: list[psutil.Process]) -> float:
    return sum(sum(process.cpu_times()[:2]) for process in processes)


def main() -> None:
    """Run the benchmark, or be one of its processes."""
    parser = script_parser(__doc__)
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)), metavar="N,N,...")
    parser.add_argument("--seconds", type=float, default=REST_S, help=f"measured ({REST_S:g})")
    parser.add_argument("--robot", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--endpoints", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.robot is not None:
        asyncio.run(take_part(options.robot, options.endpoints, options.seconds))
        return
    found = []
    for size in map(int, options.sizes.split(",")):
        found.append(measure(size, options.seconds))
        say(
            f"{size} processes: {found[-1]['cpu_percent']} % of a core, "
            f"{found[-1]['messages_per_s']} messages a second to each"
        )
    write_json({"machine": machine(), "sizes": found}, options.json)


if __name__ == "__main__":
    main()
