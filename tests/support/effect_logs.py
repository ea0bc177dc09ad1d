"""The effect logs of chaos runs, one file per seed, so that two checkouts can be compared.

    python -m tests.support.effect_logs FOLDER [--seeds 0:40] [--jobs 2]

A change that should not change behaviour leaves every file as it was: write the logs in both
checkouts and run `diff -rq` over the folders. For a checkout without this file, run this one with
that checkout's Python and folder: `cd OTHER && .venv/bin/python THIS/tests/support/effect_logs.py`.
"""

from __future__ import annotations

import argparse
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

# Line numbers of code are no behaviour.
_FRAMES = re.compile(r"Traceback \(most recent call last\):\\n(?:  .*?\\n)+(?=\w)")


def write_log(folder: Path, seed: int) -> None:
    """Run the generated mission of a seed under its chaos and write what happened."""
    from mrbt_mesh.sim.chaos.campaign import Source
    from mrbt_mesh.sim.run import run_scenario

    source = Source()
    mission, program = source.load(seed)
    result = run_scenario(mission, program, source.scenario(seed, mission), keep_log=True)
    lines = [f"{result.result} {result.duration_us} us", *result.violations]
    lines += [_FRAMES.sub("", line) for line in result.effect_log]
    (folder / f"{seed:05}.log").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", default="0:40", help="FIRST:END, without END")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    first, end = map(int, options.seeds.split(":"))
    with ProcessPoolExecutor(options.jobs) as pool:
        list(pool.map(partial(write_log, options.folder), range(first, end)))


if __name__ == "__main__":
    sys.path.insert(0, str(Path.cwd()))
    main()
