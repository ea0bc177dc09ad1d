"""The cost of proving every message, and of a flood of forged ones.

    python -m benchmarks.security [--messages 5000] [--kills 10] [--rate 20000] [--json FILE]

messages  sealing a heartbeat, checking it at the gate and opening it: median and p99 of each
at rest   a team of six: the share of that in a robot's processor time
flood     the time from a SIGKILL until the replacement has started, calm and while a stranger
          sends `--rate` changed messages a second, each to every robot
"""

from __future__ import annotations

import os
import signal
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks.failover import at_rest, failover_s, spread
from benchmarks.report import run_program, say
from benchmarks.run import Run, stranger
from mrbt_mesh.core.agent.inputs import Input, MessageReceived
from mrbt_mesh.core.membership.envelope import MAX_TAGS, Guard
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.runtime.flood_gate import FloodGate
from mrbt_mesh.runtime.member_keys import Manifest, MemberKeys, public_member, signing_key
from mrbt_mesh.runtime.settings import DEFAULT_BEAT_S, WIRED

BEAT_BYTES, ROBOTS, RUN = 350, 6, "run"
WARM_UP = 200


def team_keys(robots: int) -> list[MemberKeys]:
    """Keys of a team of `robots` and an operator, the robots' first."""
    authority = signing_key(os.urandom(32))
    names = [*(f"R{number:03}" for number in range(robots)), "operator"]
    secrets = {name: os.urandom(32) for name in names}
    roles = {name: Role.OPERATOR if name == "operator" else Role.ROBOT for name in names}
    members = {name: public_member(secrets[name], roles[name]) for name in names}
    public = authority.public_key().public_bytes_raw()
    manifest = Manifest(1, public, members).signed(authority)
    return [MemberKeys(name, secrets[name], manifest) for name in names]


def quantiles_us(step: Callable[[int], object], count: int) -> dict[str, float]:
    """Median and 99th percentile of one step, in us of the processor's time."""
    for number in range(WARM_UP):
        step(number)
    times_us = []
    for number in range(WARM_UP, WARM_UP + count):
        started_ns = time.thread_time_ns()
        step(number)
        times_us.append((time.thread_time_ns() - started_ns) / 1e3)
    cuts = statistics.quantiles(times_us, n=100)
    return {"median_us": round(cuts[49], 1), "p99_us": round(cuts[98], 1)}


def message_costs(robots: int, count: int) -> dict[str, dict[str, float]]:
    """Times of each step for a message of a team of `robots`."""
    mine, theirs, *_ = team_keys(robots)
    sender, receiver = Guard(mine, RUN, 1), Guard(theirs, RUN, 1)
    total = WARM_UP + count
    inner = [os.urandom(BEAT_BYTES) for _ in range(total)]
    sealed: list[bytes] = []
    kept: list[Input] = []

    def keep(event: Input, _: str | None) -> bool:
        kept.append(event)
        return True

    gate = FloodGate(theirs, RUN, keep)
    beat = MessageKind.HEARTBEAT

    def check(number: int) -> None:
        gate.deliver(MessageReceived(beat, mine.name, sealed[number]), "slot")

    costs = {"seal": quantiles_us(lambda number: sealed.append(sender.seal(inner[number])), count)}
    if robots <= MAX_TAGS:
        costs["gate"] = quantiles_us(check, count)
    costs["open"] = quantiles_us(lambda n: receiver.open(sealed[n], beat, mine.name), count)
    return costs


def rest_share(costs: dict[str, dict[str, float]]) -> dict[str, float]:
    """Processor time of a robot of a small team at rest, and the share for proving messages."""
    used = at_rest(ROBOTS, WIRED)["cpu_percent"]
    beats_per_s = 1 / DEFAULT_BEAT_S
    received_us = costs["gate"]["median_us"] + costs["open"]["median_us"]
    spent_us = beats_per_s * (costs["seal"]["median_us"] + (ROBOTS - 1) * received_us)
    percent = spent_us / 1e4
    return {
        "robot_cpu_percent": used,
        "proofs_cpu_percent": round(percent, 3),
        "share_percent": round(100 * percent / used, 1),
    }


def takeovers(kills: int, rate: int) -> dict[str, Any]:
    """Takeovers in turn, without a flood and in one."""
    calm_s, flood_s, rates = [], [], list[int]()

    @contextmanager
    def flood(run: Run) -> Iterator[None]:
        run.wait_for("use_screwdriver", "start")
        with stranger("flooder", run.folder, str(rate)) as process:
            yield
            sent, _ = process.communicate(timeout=30)
            rates.append(int(sent))

    for number in range(kills):
        calm_s.append(failover_s(signal.SIGKILL, WIRED))
        flood_s.append(failover_s(signal.SIGKILL, WIRED, flood))
        say(f"kill {number + 1}/{kills}: {1e3 * calm_s[-1]:.0f} ms, {1e3 * flood_s[-1]:.0f} ms")
    ratio = statistics.median(flood_s) / statistics.median(calm_s)
    found = {"calm": spread(calm_s), "flood": spread(flood_s), "times_slower": round(ratio, 2)}
    return {**found, "sent_per_s": round(statistics.median(rates))}


def measure(messages: int = 5_000, kills: int = 10, rate: int = 20_000) -> dict[str, Any]:
    """All three; without kills no flood."""
    tags = message_costs(ROBOTS, messages)
    signatures = message_costs(2 * MAX_TAGS, messages)
    found = {"tags": tags, "signatures": signatures, "at_rest": rest_share(tags)}
    return found | ({"flood": takeovers(kills, rate)} if kills else {})


if __name__ == "__main__":
    run_program(__doc__, measure)
