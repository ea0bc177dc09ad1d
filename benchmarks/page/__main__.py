"""`python -m benchmarks.page frames|cost|watched|pictures|animation`; Chromium, but for `cost`."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from benchmarks.page import animation, cost, frames, pictures, watched


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.page")
    tasks = parser.add_subparsers(dest="task", required=True)
    smooth = tasks.add_parser("frames", help="64 robots, 2,000 nodes, ten changes a second")
    smooth.add_argument("--seconds", type=float, default=60, help="600: the long form")
    share = tasks.add_parser("cost", help="processor time of `mrbt watch --web` and of a team")
    share.add_argument("--seconds", type=float, default=60)
    long = tasks.add_parser("watched", help="a team of processes with its page open for minutes")
    long.add_argument("--seconds", type=float, default=600)
    long.add_argument("--robots", type=int, default=24)
    drawn = tasks.add_parser("pictures", help="all views in all situations")
    drawn.add_argument("folder", type=Path)
    drawn.add_argument("situations", nargs="*", help="only these; default: all")
    film = tasks.add_parser("animation", help="a robot is killed, and another one takes over")
    film.add_argument("file", type=Path)
    given = parser.parse_args()
    if given.task == "animation":
        animation.make(given.file)
        return
    if given.task == "pictures":
        pictures.make(given.folder, given.situations)
        return
    if given.task == "watched":
        found = watched.measure(given.seconds, given.robots)
    else:
        found = (frames if given.task == "frames" else cost).measure(given.seconds)
    json.dump(found, sys.stdout, indent=2)
    sys.stdout.write("\n")


main()
