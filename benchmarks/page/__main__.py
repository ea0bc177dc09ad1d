"""`python -m benchmarks.page frames|cost|pictures FOLDER`. Needs Chromium (not for `cost`)."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.page import cost, frames, pictures


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page")
    tasks = parser.add_subparsers(dest="task", required=True)
    smooth = tasks.add_parser("frames", help="64 robots, 2,000 nodes, ten changes a second")
    smooth.add_argument("--seconds", type=float, default=60, help="600: the long form")
    share = tasks.add_parser("cost", help="processor time of `mrbt watch --web` and of a team")
    share.add_argument("--seconds", type=float, default=60)
    drawn = tasks.add_parser("pictures", help="those of the README")
    drawn.add_argument("folder", type=Path)
    given = parser.parse_args()
    if given.task == "pictures":
        pictures.make(given.folder)
        return
    found = (frames if given.task == "frames" else cost).measure(given.seconds)
    json.dump(found, sys.stdout, indent=2)
    sys.stdout.write("\n")


main()
