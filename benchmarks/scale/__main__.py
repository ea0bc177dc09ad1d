"""What teams cost and how fast they react, by their number of robots: docs/data/scale.md.

    python -m benchmarks.scale [--sizes 6,12,24,48,64] [--kills 5] [--beat 0.2] [--detection 1]
                               [--simulated 8,16,32,64,125,250,500,1000] [--events 3]
                               [--only processes|simulated] [--json FILE] [--write-docs]

First teams of real processes on this machine (`processes`), then larger ones in virtual time
(`simulated`). `--write-docs` puts the tables into docs/data/scale.md and the plots beside it.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import asdict
from typing import Any

from benchmarks.plots import draw
from benchmarks.registry import MissingPackageError
from benchmarks.report import page_parser, write_docs, write_json
from benchmarks.run import ROOT, machine, say
from benchmarks.scale import processes, results, simulated
from mrbt_mesh.runtime.settings import DEFAULT_BEAT_S, DEFAULT_DETECTION_S

DOCS = ROOT / "docs" / "data" / "scale.md"
PLOTS = DOCS.parent / "scale"


def sizes_of(text: str) -> list[int]:
    """The sizes of an option; raises ArgumentTypeError."""
    sizes = [int(size) for size in text.split(",")]
    if min(sizes) < 2:
        raise argparse.ArgumentTypeError("a team has at least 2 robots")
    return sizes


def main() -> None:
    """Run the benchmark."""
    parser = page_parser(__doc__, DOCS)
    parser.add_argument(
        "--sizes", type=sizes_of, default=list(processes.SIZES), metavar="N,N,...", help="processes"
    )
    parser.add_argument("--kills", type=int, default=5, help="robots killed per team (5)")
    parser.add_argument("--beat", default=str(DEFAULT_BEAT_S), help="as for `mrbt up`")
    parser.add_argument("--detection", default=str(DEFAULT_DETECTION_S), help="as for `mrbt up`")
    parser.add_argument(
        "--simulated", type=sizes_of, default=list(simulated.SIZES), metavar="N,N,..."
    )
    parser.add_argument("--events", type=int, default=3, help="of each kind, simulated (3)")
    parser.add_argument("--only", choices=("processes", "simulated"), help="one of the two parts")
    options = parser.parse_args()
    result: dict[str, Any] = {"machine": machine(), "load_before": os.getloadavg()[0]}
    parts: dict[str, str] = {}
    if options.only != "simulated":
        knobs = ("--beat", options.beat, "--detection", options.detection)
        teams = [
            processes.measure(size, min(options.kills, size // 2), *knobs) for size in options.sizes
        ]
        result |= {"beat_s": float(options.beat), "detection_s": float(options.detection)}
        result["sizes"] = [asdict(team) for team in teams]
        parts["processes"] = results.of_processes(teams)
        sys.stdout.write(parts["processes"] + "\n")
    if options.only != "processes":
        found = []
        for size in options.simulated:
            found.append(simulated.measure(size, options.events))
            say(f"{size} simulated robots: {found[-1].cpu_s:.0f} s of processor time")
        result["simulated"] = [asdict(size) for size in found]
        parts["simulated"] = results.of_simulated(found)
        sys.stdout.write(parts["simulated"] + "\n")
        if options.write_docs:
            try:
                draw(results.charts(found), PLOTS)
            except MissingPackageError as error:
                say(str(error))
    write_json(result, options.json)
    if options.write_docs:
        for name, text in parts.items():
            write_docs(DOCS, text, name)


if __name__ == "__main__":
    main()
