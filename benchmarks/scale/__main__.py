"""What teams cost and how fast they react, by their number of robots: docs/data/scale.md.

    python -m benchmarks.scale [--sizes 6 12 24 48 64] [--kills 5] [--beat 0.2] [--detection 1]
                               [--simulated 8 16 32 64 125 250 500 1000] [--events 3]
                               [--only processes|simulated] [--json FILE] [--write-docs]

First teams of real processes on this machine (`processes`), then larger ones in virtual time
(`simulated`), with `--events` of each kind. `--write-docs` puts the tables into docs/data/scale.md
and the picture into docs/scale.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from benchmarks.report import ROOT, run_program, say
from benchmarks.scale import processes, results
from benchmarks.scale.simulated import Size, measure_size
from mrbt_mesh.runtime.settings import DEFAULT_BEAT_S, DEFAULT_DETECTION_S

PAGE = ROOT / "docs" / "data" / "scale.md"
PICTURE = ROOT / "docs" / "scale" / "rest.png"


def measure(
    sizes: Sequence[int] = (6, 12, 24, 48, 64),
    kills: int = 5,
    beat: float = DEFAULT_BEAT_S,
    detection: float = DEFAULT_DETECTION_S,
    simulated: Sequence[int] = (8, 16, 32, 64, 125, 250, 500, 1_000),
    events: int = 3,
    only: str = "",
) -> dict[str, Any]:
    """Teams of these sizes, as processes and simulated."""
    if min(*sizes, *simulated, 2) < 2:
        raise SystemExit("a team has at least 2 robots")
    if only not in ("", "processes", "simulated"):
        raise SystemExit("--only: processes or simulated")
    found: dict[str, Any] = {}
    tables: dict[str, str] = {}
    if only != "simulated":
        knobs = ("--beat", str(beat), "--detection", str(detection))
        teams = [processes.measure(size, min(kills, size // 2), *knobs) for size in sizes]
        found["sizes"] = [asdict(team) for team in teams]
        tables["processes"] = results.of_processes(teams)
    if only != "processes":
        stories = [_simulated(size, events) for size in simulated]
        found["simulated"] = [asdict(story) for story in stories]
        tables["simulated"] = results.of_simulated(stories)
    return {**found, "tables": tables}


def _simulated(size: int, events: int) -> Size:
    found = measure_size(size, events)
    say(f"{size} simulated robots: {found.cpu_s:.0f} s of processor time")
    return found


if __name__ == "__main__":
    rows = run_program(__doc__, measure, PAGE).get("simulated", ())
    if rows and "--write-docs" in sys.argv:
        results.draw(rows, PICTURE)
