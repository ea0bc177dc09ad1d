"""What teams cost, and how fast they are, by their number of robots: docs/scale.md.

    python -m benchmarks.scale [--sizes 6,12,24,48,64] [--kills 5] [--beat 0.2] [--detection 1]
                               [--simulated 8,16,32,64,125,250,500,1000] [--events 3]
                               [--only processes|simulated] [--jobs 2] [--json FILE] [--write-docs]

First teams of real processes on this machine (`processes`), then larger ones in virtual time
(`simulated`). `--write-docs` puts the tables into docs/scale.md and the plots beside it.
"""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.plots import draw
from benchmarks.registry import MissingPackageError
from benchmarks.report import write_docs
from benchmarks.run import machine, say
from benchmarks.scale import processes, results, simulated
from mrbt_mesh.runtime.settings import DEFAULT_BEAT_S, DEFAULT_DETECTION_S

DOCS = Path(__file__).resolve().parents[2] / "docs" / "scale.md"
PLOTS = DOCS.parent / "scale"


def sizes_of(text: str) -> list[int]:
    """The sizes of an option; raises ArgumentTypeError."""
    sizes = [int(size) for size in text.split(",")]
    if min(sizes) < 2:
        raise argparse.ArgumentTypeError("a team has at least 2 robots")
    return sizes


def main() -> None:
    """Run the benchmark."""
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.scale",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--sizes", type=sizes_of, default=list(processes.SIZES), metavar="N,N,...", help="processes"
    )
    parser.add_argument("--kills", type=int, default=5, help="robots killed per team (5)")
    parser.add_argument("--beat", default=str(DEFAULT_BEAT_S), help="as of `mrbt up`")
    parser.add_argument("--detection", default=str(DEFAULT_DETECTION_S), help="as of `mrbt up`")
    parser.add_argument(
        "--simulated", type=sizes_of, default=list(simulated.SIZES), metavar="N,N,..."
    )
    parser.add_argument("--events", type=int, default=3, help="of each kind, simulated (3)")
    parser.add_argument("--only", choices=("processes", "simulated"), help="one of the two parts")
    parser.add_argument("--json", type=Path, help="also write the result here")
    parser.add_argument("--write-docs", action="store_true", help="update docs/scale.md")
    options = parser.parse_args()
    result: dict[str, Any] = {"machine": machine(), "load_before": os.getloadavg()[0]}
    parts: dict[str, str] = {}
    if options.only != "simulated":
        knobs = ("--beat", options.beat, "--detection", options.detection)
        teams = [
            processes.measure(size, min(options.kills, size // 2), *knobs) for size in options.sizes
        ]
        Console(width=max(Console().width, 120)).print(processes.table(teams))
        result |= {"beat_s": float(options.beat), "detection_s": float(options.detection)}
        result["sizes"] = [asdict(team) for team in teams]
        parts["processes"] = results.of_processes(teams)
    if options.only != "processes":
        found = []
        for size in options.simulated:
            found.append(simulated.measure(size, options.events))
            say(f"{size} simulated robots: {found[-1].cpu_s:.0f} s of processor time")
        result["simulated"] = [asdict(size) for size in found]
        parts["simulated"] = results.of_simulated(found)
        Console().print(parts["simulated"], markup=False, soft_wrap=True)
        if options.write_docs:
            try:
                draw(results.charts(found), PLOTS)
            except MissingPackageError as error:
                say(str(error))
    if options.json is not None:
        options.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    if options.write_docs:
        for name, text in parts.items():
            write_docs(DOCS, text, name)


if __name__ == "__main__":
    main()
