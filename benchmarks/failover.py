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
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from benchmarks.report import script_parser
from benchmarks.run import REPAIR, WAIT_S, Run, machine, say, tell

DETECTION_S = 1.0
REST_S = 10.0

REST_MISSION = """\
mission: at_rest
program: {program}
local_tasks: {{wait: {{work: 1}}}}
conditions: {{wanted: {{default: false}}}}
robot_types: {{R: {{capabilities: {{wait: 1}}}}}}
robots: {{{robots}}}
global_tasks: {{work: {{needs: {{wait: {{min: 1}}}}}}}}
tree:
  KeepRunningUntilFailure:
    Fallback:
      - Inverter: {{Condition: wanted}}
      - work
"""


@contextmanager
def team(mission: Path, *options: str) -> Iterator[Run]:
    """A running team."""
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        run = Run(Path(folder), mission, *options)
        try:
            yield run
        finally:
            run.stop()


def failover_s(
    number: signal.Signals,
    transport: str,
    meanwhile: Callable[[Run], AbstractContextManager[object]] = nullcontext,
) -> float:
    """Seconds from the signal to the replacement's start, and what goes on `meanwhile`.

    The victim is the robot that replaces the hardware of part 2; both B robots are free then
    and can do it.
    """
    options = ("--speed", "4", "--detection", str(DETECTION_S), "--transport", transport)
    with team(REPAIR, *options) as run, meanwhile(run):
        begun = run.wait_for("replace_hw", "start", args=["2"])
        pid = run.processes()[begun["robot"]].pid
        # In the middle of the action, so that the fault is not mixed up with the start.
        time.sleep(0.1)
        fault_s = time.time()
        os.kill(pid, number)
        deadline = time.monotonic() + WAIT_S
        while time.monotonic() < deadline:
            for line in run.events():
                taken = line["activation"] == begun["activation"] and line["event"] == "start"
                if taken and line["robot"] != begun["robot"]:
                    return float(line["t"]) - fault_s
            time.sleep(0.005)
    raise TimeoutError("nobody took over")


def at_rest(count: int, transport: str) -> dict[str, float]:
    """Resident memory (MB) and CPU share (%) of one process, of `count` at rest."""
    robots = ", ".join(f"R{i:02d}: R" for i in range(count))
    with tempfile.TemporaryDirectory(prefix="mrbt-bench-") as folder:
        mission = Path(folder) / "mission.yaml"
        program = Path(folder) / "robot.py"
        program.write_text(
            "from mrbt_mesh import RobotProgram, TaskContext\n"
            "robot = RobotProgram()\n"
            "@robot.local_task('wait')\n"
            "async def wait(task: TaskContext) -> None:\n"
            "    pass\n"
        )
        mission.write_text(REST_MISSION.format(program=program.name, robots=robots))
        with team(mission, "--transport", transport) as run:
            run.wait_for_processes(count)
            time.sleep(5.0)
            processes = list(run.processes().values())
            before = [sum(p.cpu_times()[:2]) for p in processes]
            time.sleep(REST_S)
            after = [sum(p.cpu_times()[:2]) for p in processes]
            shares = [100 * (b - a) / REST_S for a, b in zip(before, after, strict=True)]
            memory = [p.memory_info().rss / 1e6 for p in processes]
            unique = [p.memory_full_info().uss / 1e6 for p in processes]
    return {
        "processes": count,
        "rss_mb": round(statistics.median(memory), 1),
        "uss_mb": round(statistics.median(unique), 1),
        "cpu_percent": round(statistics.median(shares), 2),
    }


def spread(times_s: list[float]) -> dict[str, float]:
    """Median, 90th percentile and extremes, in ms."""
    ordered = sorted(times_s)
    p90 = ordered[min(len(ordered) - 1, round(0.9 * len(ordered)))]
    return {
        "trials": len(ordered),
        "median_ms": round(1e3 * statistics.median(ordered), 1),
        "p90_ms": round(1e3 * p90, 1),
        "min_ms": round(1e3 * ordered[0], 1),
        "max_ms": round(1e3 * ordered[-1], 1),
    }


def trials(number: signal.Signals, count: int, name: str, transport: str) -> dict[str, float]:
    """Several failovers, with progress."""
    times_s = []
    for index in range(count):
        times_s.append(failover_s(number, transport))
        say(f"{name} {index + 1}/{count}: {1e3 * times_s[-1]:.1f} ms")
    return spread(times_s)


def main() -> None:
    """Run the benchmark."""
    parser = script_parser(__doc__)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--freezes", type=int, default=5)
    parser.add_argument("--transport", choices=("wired", "wireless"), default="wired")
    options = parser.parse_args()
    result: dict[str, Any] = {
        "machine": machine(),
        "load_before": os.getloadavg()[0],
        "detection_s": DETECTION_S,
        "transport": options.transport,
    }
    if options.kills:
        result["kill"] = trials(signal.SIGKILL, options.kills, "kill", options.transport)
    if options.freezes:
        result["freeze"] = trials(signal.SIGSTOP, options.freezes, "freeze", options.transport)
    result["at_rest"] = []
    for count in (6, 24):
        say(f"{count} processes at rest ...")
        result["at_rest"].append(at_rest(count, options.transport))
    tell(result, options.json)


if __name__ == "__main__":
    main()
