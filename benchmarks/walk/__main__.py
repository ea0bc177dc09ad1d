"""Through how many files one event goes, and how often one has to go on in another file.

    python -m benchmarks.walk [--pairs 15] [--json FILE]

Three walks: a robot of three ends a diagnosis, until another one starts the repair that it led
to; a robot is killed at work, until another one takes over; `mrbt plan` of the vehicle repair. In
the first two, of the agents' code alone: `Agent.handle` and `next_deadline_us`, and the files of
mrbt_mesh/core that they enter. The team has worked before, so that nothing is made for the first
time. `step` is the one call of `handle` that takes the outcome in. An edge leads from one file to
another, by a call or a return, however often.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from benchmarks.report import ROOT
from benchmarks.run import REPAIR
from benchmarks.walk.team import Walk
from benchmarks.walk.trace import Trace

CORE = "core/"
AGENT = "agent.py"
COLUMNS = ("files", "packages", "edges", "jumps", "jumps_between_packages")


def counted(trace: Trace) -> dict[str, Any]:
    """A trace in the core, as data."""
    core = trace.within(CORE)
    jumps = [[one, other, count] for (one, other), count in core.jumps().most_common()]
    return core.figures() | {
        "back_into_agent": core.entries_from_elsewhere(AGENT),
        "entered": dict(core.files()),
        "between": jumps,
    }


def outcome() -> dict[str, Any]:
    walk = Walk()
    trace = walk.outcome()
    sender = trace.of(walk.sender)
    return {
        "all": counted(trace),
        "sender": counted(sender),
        "step": counted(sender.first_step()),
    }


def kill() -> dict[str, Any]:
    walk = Walk()
    trace = walk.kill()
    return {"all": counted(trace), "successor": counted(trace.of(walk.started))}


def plan() -> dict[str, Any]:
    command = [sys.executable, "-m", "benchmarks.walk.command", "plan", str(REPAIR)]
    return dict(json.loads(subprocess.check_output(command, cwd=ROOT, text=True)))


def row(name: str, figures: dict[str, Any]) -> str:
    numbers = "".join(f"{figures[column]:>10}" for column in COLUMNS)
    back = figures.get("back_into_agent", "")
    return f"{name:<44}{numbers}{back:>10}"


def text(found: dict[str, Any], pairs: int) -> str:
    """The figures as a table, then what the one step of the sender enters."""
    step = found["outcome"]["step"]
    lines = [
        f"{'':<74}{'jumps':>10}{'between':>10}{'back into':>10}",
        f"{'':<44}{'files':>10}{'packages':>10}{'edges':>10}{'':>10}{'packages':>10}{AGENT:>10}",
        row("ActionFinished to StartAction, all robots", found["outcome"]["all"]),
        row("  the sender", found["outcome"]["sender"]),
        row("  the sender's step with the outcome", step),
        row("kill to takeover, all robots", found["kill"]["all"]),
        row("  the robot that takes over", found["kill"]["successor"]),
        row("mrbt plan, mrbt_mesh", found["plan"]["product"]),
        row("  its core", found["plan"]["core"]),
        "",
        f"mrbt plan imports {len(found['plan']['modules_imported'])} modules of mrbt_mesh, and "
        f"{', '.join(found['plan']['libraries_imported']) or 'no large library'}",
        "",
        "The sender's step with the outcome: files, in the order in which they are entered",
        *(f"{count:>6}  {file}" for file, count in step["entered"].items()),
        "",
        "and the jumps between them",
        *(f"{count:>6}  {one} > {other}" for one, other, count in step["between"][:pairs]),
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--pairs", type=int, default=15, help="pairs of files to print (default 15)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all that was counted here")
    options = parser.parse_args()
    found = {"outcome": outcome(), "kill": kill(), "plan": plan()}
    sys.stdout.write(text(found, options.pairs) + "\n")
    if options.json is not None:
        options.json.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
