"""Time from a fault until the replacement has started, on real processes.

    python -m benchmarks.failover [--kills 20] [--freezes 5] [--transport wireless] [--json FILE]

For each trial a team of the vehicle repair is started, and the robot that has just begun its
longest task is killed (SIGKILL) or frozen (SIGSTOP) while a capable robot is free. The time
runs from the signal to the replacement's own start line in events.jsonl. Afterwards the same
team is left at rest with 6 and with 24 processes, and memory and CPU share are read.
"""

from __future__ import annotations

import os
import signal
import statistics
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from benchmarks.missions import write_rest
from benchmarks.report import run_program, say
from benchmarks.run import REPAIR, Run, cpu_s, team, until

DETECTION_S = 1.0
SETTLE_S, REST_S = 5.0, 10.0


def failover_s(
    number: signal.Signals,
    transport: str,
    meanwhile: Callable[[Run], AbstractContextManager[object]] = nullcontext,
) -> float:
    """Seconds from the signal to the replacement's start, with something going on `meanwhile`.

    The victim is the robot that replaces the hardware of part 2; both B robots are free then
    and can do it.
    """
    options = ("--speed", "4", "--detection", str(DETECTION_S), "--transport", transport)
    with team(lambda _: REPAIR, *options) as run, meanwhile(run):
        begun = run.wait_for("replace_hw", "start", args=["2"])
        pid = run.processes()[begun["robot"]].pid
        # In the middle of the action, so that the fault is not mixed up with the start.
        time.sleep(0.1)
        fault_s = time.time()
        os.kill(pid, number)

        def taken_over() -> float | None:
            for line in run.events():
                taken = line["activation"] == begun["activation"] and line["event"] == "start"
                if taken and line["robot"] != begun["robot"]:
                    return float(line["t"]) - fault_s
            return None

        if (found_s := until(taken_over)) is None:
            raise TimeoutError("nobody took over")
        return found_s


def at_rest(count: int, transport: str) -> dict[str, float]:
    """Resident memory (MB) and CPU share (%) of one process, of `count` at rest."""
    robots = [f"R{number:02d}" for number in range(count)]
    say(f"{count} processes at rest ...")
    with team(lambda folder: write_rest(folder, robots), "--transport", transport) as run:
        run.wait_for_processes(count)
        time.sleep(SETTLE_S)
        processes = list(run.processes().values())
        before_s = [cpu_s([process]) for process in processes]
        time.sleep(REST_S)
        spent_s = [cpu_s([p]) - before for p, before in zip(processes, before_s, strict=True)]
        memory = [process.memory_full_info() for process in processes]
    return {
        "processes": count,
        "rss_mb": round(statistics.median(each.rss for each in memory) / 1e6, 1),
        "uss_mb": round(statistics.median(each.uss for each in memory) / 1e6, 1),
        "cpu_percent": round(100 * statistics.median(spent_s) / REST_S, 2),
    }


def spread(times_s: list[float]) -> dict[str, float]:
    """Median, 90th percentile and extremes, in ms."""
    ordered = [round(1e3 * time_s, 1) for time_s in sorted(times_s)]
    return {
        "trials": len(ordered),
        "median_ms": round(statistics.median(ordered), 1),
        "p90_ms": ordered[min(len(ordered) - 1, round(0.9 * len(ordered)))],
        "min_ms": ordered[0],
        "max_ms": ordered[-1],
    }


def measure(kills: int = 20, freezes: int = 5, transport: str = "wired") -> dict[str, Any]:
    """Failovers of both kinds, then teams at rest."""
    result: dict[str, Any] = {"detection_s": DETECTION_S}
    faults = (("kill", signal.SIGKILL, kills), ("freeze", signal.SIGSTOP, freezes))
    for name, number, count in faults:
        times_s: list[float] = []
        for index in range(count):
            times_s.append(failover_s(number, transport))
            say(f"{name} {index + 1}/{count}: {1e3 * times_s[-1]:.1f} ms")
        if times_s:
            result[name] = spread(times_s)
    result["at_rest"] = [at_rest(count, transport) for count in (6, 24)]
    return result


if __name__ == "__main__":
    run_program(__doc__, measure)
