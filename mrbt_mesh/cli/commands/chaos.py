"""`mrbt sim chaos`: many runs with random faults, and their invariants."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path

import click

from mrbt_mesh.cli.command import PATH, FiniteNumber, MrbtCommand, refuse
from mrbt_mesh.cli.options import (
    jobs_option,
    json_option,
    optional_mission_argument,
    program_option,
    speed_option,
)
from mrbt_mesh.errors import InputError


@click.command(cls=MrbtCommand)
@optional_mission_argument
@click.option("--generated", is_flag=True, help="Instead of MISSION: a random one for each seed.")
@click.option(
    "--seeds", metavar="0:1000|3,9", help="FIRST:END (without END), or a list. Default: 0:100."
)
@click.option(
    "--minutes",
    type=FiniteNumber(0, min_open=True),
    help="Go on from the first seed for this long.",
)
@program_option
@speed_option
@jobs_option
@click.option(
    "--keep",
    type=PATH,
    default="chaos-failures",
    metavar="DIR",
    help="Folder for the runs that failed.",
)
@click.option(
    "--minimise",
    type=FiniteNumber(0),
    default=60.0,
    metavar="SECONDS",
    help="Time to minimise the faults of a failed run; 0: none.",
)
@json_option
def chaos(
    *,
    mission: Path | None,
    generated: bool,
    seeds: str | None,
    minutes: float | None,
    program: str | None,
    speed: float,
    jobs: int | None,
    keep: Path,
    minimise: float,
    as_json: bool,
) -> None:
    """Run a mission with random faults, many times, and check the invariants.

    Each seed draws its own faults: crashes, partitions, one-way links, loss, slow robots, skewed
    clocks, replayed messages and more. A run in which an invariant broke is written to --keep with
    the fewest faults that it takes; `mrbt sim run --schedule FILE` repeats it.

    Exit status: 0 no invariant broke, 1 one did, 2 bad input, 3 interrupted.

    \b
    Example: mrbt sim chaos examples/dispense/mission.yaml --seeds 0:200
             mrbt sim chaos --generated --seeds 0:1000 --jobs 2
    """
    from mrbt_mesh.cli.options import checked_program
    from mrbt_mesh.cli.virtual.campaign import Campaign, run_campaign
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.sim.chaos.campaign import Source

    if (mission is None) is not generated:
        raise InputError("give a MISSION, or --generated for random ones")
    if keep.exists() and not keep.is_dir():
        raise InputError(f"--keep {keep}: is a file; name a folder")
    if mission is None:
        refuse("a generated mission has a program of its own", "--program")
        source = Source(speed=speed)
    else:
        loaded = load_mission(mission)
        reference = checked_program(loaded, sorted(loaded.robots), program)
        source = Source(str(mission), reference, speed)
    chosen = parse_seeds(seeds, is_endless=minutes is not None)
    campaign = Campaign(source, chosen, jobs or os.cpu_count() or 1, keep, minimise, minutes)
    run_campaign(campaign, as_json)


def parse_seeds(text: str | None, is_endless: bool) -> Sequence[int]:
    """Parse seeds: `0:1000` (without the last), `7`, or `3,9,12`; None: 0 to 99.

    With `is_endless`, only the first seed may be given; the campaign continues from there.
    Raises InputError.
    """
    if text is None:
        return range(100)
    match = re.fullmatch(r"(\d+):(\d+)|\d+(?:,\d+)*", text, re.ASCII)
    if match is None or (match[1] and int(match[1]) >= int(match[2])):
        raise InputError(f"--seeds {text}: expected FIRST:END, e.g. 0:1000, or seeds, e.g. 3,9")
    seeds: Sequence[int] = (
        range(int(match[1]), int(match[2])) if match[1] else [*map(int, text.split(","))]
    )
    if not match[1] and len(set(seeds)) < len(seeds):
        raise InputError(f"--seeds {text}: a seed is named twice")
    if is_endless and (match[1] or len(seeds) > 1):
        raise InputError(f"--seeds {text}: with --minutes only the first seed, e.g. {seeds[0]}")
    return seeds
