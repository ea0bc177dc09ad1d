"""`mrbt chaos`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import (
    JobsOption,
    JsonOption,
    OptionalMissionArgument,
    ProgramOption,
    SpeedOption,
)
from mrbt_mesh.errors import InputError


@dataclass(frozen=True)
class SeedOptions:
    """Which random faults, and how many."""

    seeds: Annotated[
        str | None,
        option("FIRST:END (without END itself), or some. Default: 0:100.", "0:1000|3,9"),
    ] = None
    minutes: Annotated[
        float | None,
        option("Go on from the first seed for this long.", above=0),
    ] = None


@dataclass(frozen=True)
class KeepOptions:
    """What is done with a run in which an invariant broke."""

    keep: Annotated[Path, option("What fails is written there.", "DIR")] = Path("chaos-failures")
    minimise: Annotated[
        float,
        option(
            "Time to cut down the faults of a failed run; 0: none.",
            "SECONDS",
            least=0,
        ),
    ] = 60.0


def chaos(
    *,
    mission: OptionalMissionArgument = None,
    generated: Annotated[bool, option("Instead of MISSION: a random one for each seed.")] = False,
    which: SeedOptions,
    program: ProgramOption = None,
    speed: SpeedOption = 1.0,
    jobs: JobsOption = None,
    failures: KeepOptions,
    as_json: JsonOption = False,
    given: Given,
) -> None:
    """Run a mission with random faults, many times, and check what must always hold.

    Each seed draws its own faults: crashes, partitions, one-way links, loss, slow robots, skewed
    clocks, replayed messages and more. A run in which an invariant broke is written to --keep,
    its faults cut down to those that it takes; `mrbt sim --schedule FILE` replays it.

    Exit status: 0 no invariant broke, 1 one did, 2 bad input, 3 interrupted.

    Example: mrbt chaos examples/dispense/mission.yaml --seeds 0:200

    Example: mrbt chaos --generated --seeds 0:1000 --jobs 2
    """
    import os

    from mrbt_mesh.cli.missions import checked_program
    from mrbt_mesh.cli.virtual.campaign import Campaign, run_campaign
    from mrbt_mesh.cli.virtual.seeds import parse_seeds
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.sim.chaos.campaign import Source

    if (mission is None) is not generated:
        raise InputError("give a MISSION, or --generated for random ones")
    if failures.keep.exists() and not failures.keep.is_dir():
        raise InputError(f"--keep {failures.keep}: is a file; name a folder")
    if mission is None:
        given.refuse(["--program"], "a generated mission has a program of its own")
        source = Source(speed=speed)
    else:
        loaded = load_mission(mission)
        reference = checked_program(loaded, sorted(loaded.robots), program)
        source = Source(str(mission), reference, speed)
    seeds = parse_seeds(which.seeds, is_endless=which.minutes is not None)
    campaign = Campaign(
        source,
        seeds,
        jobs=jobs or os.cpu_count() or 1,
        keep=failures.keep,
        budget_s=failures.minimise,
        minutes=which.minutes,
    )
    run_campaign(campaign, as_json)
