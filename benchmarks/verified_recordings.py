"""Verifies recorded runs of teams with keys: honest ones, and forgeries of every kind.

    python -m benchmarks.verified_recordings [--honest 200] [--forged 200] [--seed 0] [--drills all]

Honest runs: random faults in the simulator (partitions, loss, freezes, restarts), and all drills on
real processes. Forgeries: of some of these runs, by `tests/support/forger.py`, without keys, and
again with the stolen key of the robot whose recording it is. Exit status 1 for a false alarm, or a
forgery without keys that passes unnamed.
"""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.report import CORES, ROOT, grid, in_processes, run_program, say
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.recording.channels import FAULTS
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.run_dir import KEYS_FOLDER
from mrbt_mesh.views.replay.findings import GapKind
from mrbt_mesh.views.replay.verify import verify
from tests.support.forger import FORGERIES, Cast, Run, behind_signatures, forged, written_again
from tests.support.recorded import read_all, record_chaos

# How many simulated runs are forged, and as many of real processes.
FORGED_RUNS = 6
MRBT = (sys.executable, "-m", "mrbt_mesh")


@dataclass(frozen=True)
class KeyedRun:
    """A recorded run; `keys`: those of its robots, and as "" of its observer."""

    name: str
    run: Run
    manifest: Manifest
    keys: Mapping[str, Keys]


def measure(
    honest: int = 200, forged: int = 200, seed: int = 0, drills: str = "all"
) -> dict[str, Any]:
    """Count; `drills`: all, quick or none."""
    with tempfile.TemporaryDirectory(prefix="mrbt-verified-") as name:
        folder = Path(name)
        alarms, unseen = [], []
        for name, doubts, ends in _simulated(range(seed, seed + honest), folder):
            if doubts:
                alarms.append((name, doubts))
            elif ends:
                unseen.append(name)
        held, real = _drills(drills, folder)
        runs = [*_again(seed, folder), *real[:FORGED_RUNS]]
        passed, table = _forge(runs, forged, seed, folder)
    real_alarms = [each for each in held if each[1]]
    text = (
        f"{honest} honest simulated runs with random faults (`mrbt sim chaos --generated --seeds`, "
        f"from {seed}): {len(alarms)} false alarms. In {len(unseen)} of them robots died when no "
        "other was left to notice, and verify says that their ends are not proved.\n\n"
        f"{len(held)} honest runs of drills on real processes: {len(real_alarms)} false alarms."
    )
    return {
        "tables": {"honest": text, "forged": table},
        "false_alarms": [*alarms, *real_alarms],
        "unseen_ends": unseen,
        "unnamed": passed,
    }


# -- honest runs --------------------------------------------------------------------------------


def _verified(seed: int, folder: Path) -> tuple[str, str]:
    """What is not proved of a simulated run: in general, and of how recordings end.

    A recording without an end is that of a robot that was killed: nobody has changed it.
    """
    with tempfile.TemporaryDirectory(dir=folder) as name:
        _, manifest = record_chaos(Path(name), seed)
        verdict = verify(read_all(Path(name)), manifest)
    ends = [gap for gap in verdict.gaps if gap.kind is GapKind.END]
    others = [gap for gap in verdict.gaps if gap.kind is not GapKind.END]
    return _lines([*verdict.findings, *others]), _lines(ends)


def _lines(doubts: Sequence[object]) -> str:
    return "\n".join(map(str, doubts[:5]))


def _simulated(seeds: Iterable[int], folder: Path) -> Iterator[tuple[str, str, str]]:
    calls = [(seed, partial(_verified, seed, folder)) for seed in seeds]
    for seed, (doubts, ends) in in_processes(calls, CORES):
        if doubts or ends:
            say(f"seed {seed}: {doubts or ends}")
        yield f"seed {seed}", doubts, ends


def _drills(which: str, folder: Path) -> tuple[list[tuple[str, str]], list[KeyedRun]]:
    """(drill, what is not proved) of all that this machine can hold, and their runs."""
    if which == "none":
        return [], []
    choice = {"all": ["--all"], "quick": ["--all", "--quick"]}.get(which, [which])
    report = subprocess.run(
        [*MRBT, "drill", *choice, "--keep", "--json"],
        cwd=ROOT,
        env=os.environ | {"MRBT_STATE_DIR": str(folder)},
        stdout=subprocess.PIPE,
        check=False,
    )
    held, runs = [], []
    for row in json.loads(report.stdout)["runs"]:
        if row["run_dir"] is None:
            say(f"{row['drill']}: not held")
            continue
        path, words = Path(row["run_dir"]), [*MRBT, "recording", "verify", row["run_dir"], "--json"]
        done = subprocess.run(words, stdout=subprocess.PIPE, check=False)
        verdict = json.loads(done.stdout)
        doubts = json.dumps(verdict["findings"][:5] + verdict["not_proved"])
        held.append((row["drill"], "" if verdict["verified"] else doubts))
        say(f"{row['drill']}: {'verified' if verdict['verified'] else doubts}")
        if (path / KEYS_FOLDER).is_dir():
            runs.append(_real(row["drill"], path))
    return held, runs


def _real(name: str, path: Path) -> KeyedRun:
    keys, run = KeyFolder(path / KEYS_FOLDER), {each.name: each for each in read_all(path)}
    robots = {each.metadata.robot for each in run.values() if each.metadata.robot}
    return KeyedRun(name, run, keys.manifest(), {robot: keys.keys_of(robot) for robot in robots})


def _again(seed: int, folder: Path) -> Iterator[KeyedRun]:
    """Simulated runs to be forged."""
    for each in range(seed, seed + FORGED_RUNS):
        keys, manifest = record_chaos(folder / f"forged-{each}", each)
        run = {file.name: file for file in read_all(folder / f"forged-{each}")}
        yield KeyedRun(f"seed {each}", run, manifest, keys)


# -- forgeries ----------------------------------------------------------------------------------


def _forge(runs: list[KeyedRun], wanted: int, seed: int, folder: Path) -> tuple[list[str], str]:
    """(forgeries without keys that pass unnamed, table of all); a run, a file and what is changed
    in it are drawn from the seed, kind by kind.
    """
    draw, passed = random.Random(seed), list[str]()
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in FORGERIES}
    place = folder / "forgeries"
    tried = 0
    for attempt in range(20 * wanted):
        if tried == wanted:
            break
        kind = list(FORGERIES)[attempt % len(FORGERIES)]
        each = draw.choice(runs)
        cast = _cast(each.run, draw)
        run = forged(kind, each.run, cast)
        if run is None:
            continue
        if behind_signatures(run, each.run):
            counts[kind]["unsigned"] += 1
            continue
        tried += 1
        counts[kind]["tried"] += 1
        where = f"{each.name}: {kind}, {cast.file}"
        if _is_named(run, {}, each, place):
            counts[kind]["named"] += 1
        else:
            passed.append(where)
            say(f"passes unnamed: {where}")
        robot = each.run[cast.file].metadata.robot
        if robot:
            counts[kind]["stolen"] += 1
            counts[kind]["found"] += _is_named(run, {cast.file: each.keys[robot]}, each, place)
    rows = [
        (kind, f"{c['named']} of {c['tried']}", f"{c['found']} of {c['stolen']}", c["unsigned"])
        for kind, c in counts.items()
    ]
    names = ", ".join(each.name for each in runs)
    text = f"{tried} forgeries (draw {seed}) of {names}: {len(passed)} pass unnamed.\n\n"
    head = ("forgery", "named", "named with the robot's key", "left out: behind the last signature")
    return passed, text + grid(head, rows)


def _cast(run: Run, draw: random.Random) -> Cast:
    robots = sorted({each.metadata.robot for each in run.values() if each.metadata.robot})
    dead = {
        record.data["robot"]
        for each in run.values()
        for record in each.records
        if record.topic == FAULTS and record.data["event"] == "dead"
    }
    file, other = draw.choice(sorted(run)), draw.choice(robots)
    return Cast(file, draw.choice(sorted(dead) or robots), other, draw)


def _is_named(run: Run, keys: Mapping[str, Keys], of: KeyedRun, folder: Path) -> bool:
    """Whether what is found names a file, or a robot, whose recording is another one."""
    verdict = verify(written_again(run, folder, keys, of.run), of.manifest)
    changed = {name for name, each in of.run.items() if run.get(name) is not each}
    names = changed | {of.run[name].metadata.robot for name in changed} - {""}
    return any(name in str(each) for name in names for each in (*verdict.findings, *verdict.gaps))


if __name__ == "__main__":
    found = run_program(__doc__, measure)
    raise SystemExit(1 if found["false_alarms"] or found["unnamed"] else 0)
