"""`mrbt sim estimate`: how likely a mission succeeds, by many runs with random failures."""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import FAILURE, NOT_FINISHED, FiniteNumber, MrbtCommand, fail, refuse
from mrbt_mesh.cli.options import (
    jobs_option,
    json_option,
    mission_argument,
    program_option,
    seed_option,
    speed_option,
    virtual_timeout_option,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.sim.world.setup import FailureModel

_rate = partial(click.option, multiple=True, metavar="[WHO:]P[/action|/hour]")
_count = partial(click.option, type=click.IntRange(0), default=0, metavar="N")
_seconds = partial(click.option, type=FiniteNumber(0, min_open=True), metavar="SECONDS")


@click.command(cls=MrbtCommand)
@mission_argument
@_rate("--fault-rate", help="Robots die: a chance per completed action, or a number per hour.")
@_rate("--minor-rate", help="Robots lose a capability, likewise.")
@click.option(
    "--failure-rate",
    multiple=True,
    metavar="[LOCAL_TASK:]P",
    help="Actions fail with this probability.",
)
@_count("--major", help="Number of robots that die, at random times.")
@_count("--minor", help="Number of capabilities that are lost, at random times.")
@_seconds("--within", help="Time for --major and --minor. Default: that of an undisturbed mission.")
@_seconds("--return-after", help="Dead robots are restarted.")
@_seconds("--repair-after", help="Lost capabilities come back.")
@click.option("--runs", type=click.IntRange(1), default=1_000, metavar="N", help="Number of runs.")
@seed_option
@jobs_option
@virtual_timeout_option
@speed_option
@program_option
@json_option
def estimate(
    mission: Path,
    runs: int,
    seed: int,
    jobs: int | None,
    timeout: float,
    speed: float,
    program: str | None,
    as_json: bool,
    **failures: Any,
) -> None:
    """Estimate how likely a mission succeeds and how long it takes when robots fail by chance.

    Makes many runs of the same agents in virtual time. A run that can never go on is ended early,
    as blocked. The same options and seed print the same figures, whatever --jobs. WHO is a robot or
    a robot type; without it, all robots.

    Exit status: 0 the runs were made, 1 an agent or a program broke, 2 bad input, 3 interrupted.

    \b
    Example: mrbt sim estimate MISSION --fault-rate 0.05/action
             mrbt sim estimate MISSION --fault-rate A:2/hour --repair-after 30
    """
    from mrbt_mesh.cli.options import checked_program
    from mrbt_mesh.cli.terminal import console, print_json, with_bar
    from mrbt_mesh.cli.views.estimate_view import render_estimate
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.sim.estimate import Experiment, outcomes, summarise
    from mrbt_mesh.sim.run import SimulationError

    loaded = load_mission(mission)
    experiment = Experiment(
        str(mission),
        checked_program(loaded, sorted(loaded.robots), program),
        _failure_model(loaded, **failures),
        runs,
        seed,
        speed,
        round(timeout * 1e6),
    )
    jobs, started_s = jobs or os.cpu_count() or 1, time.monotonic()
    try:
        found, interrupted = with_bar("estimate", outcomes(experiment, jobs), runs)
    except SimulationError as error:
        fail(str(error), FAILURE)
    if as_json:
        head = {"mission": loaded.name, "runs": 0, "seed": seed, "interrupted": interrupted}
        print_json(head | (summarise(found).to_json() if found else {}))
    elif found:
        took_s = time.monotonic() - started_s
        console.print(render_estimate(loaded, summarise(found), took_s, jobs))
    if interrupted:
        fail("interrupted", NOT_FINISHED)


def _failure_model(
    mission: Mission,
    *,
    fault_rate: tuple[str, ...],
    minor_rate: tuple[str, ...],
    failure_rate: tuple[str, ...],
    major: int,
    minor: int,
    within: float | None,
    return_after: float | None,
    repair_after: float | None,
) -> FailureModel:
    """The same for the simulator; raises InputError, also for options without effect."""
    from mrbt_mesh.cli.virtual.settings import check_counts, parse_chances, parse_rates
    from mrbt_mesh.sim.world.setup import FailureModel

    check_counts(mission, major, minor)
    if not major and not minor:
        refuse("for --major and --minor, of which there are none", "--within")
    if not major and not fault_rate:
        refuse("no robot dies: see --fault-rate and --major", "--return-after")
    if not minor and not minor_rate:
        refuse("no capability is lost: see --minor-rate and --minor", "--repair-after")
    return FailureModel(
        major=parse_rates("fault-rate", fault_rate, mission),
        minor=parse_rates("minor-rate", minor_rate, mission),
        actions=parse_chances("failure-rate", failure_rate, mission),
        major_faults=major,
        minor_faults=minor,
        within_us=_microseconds(within) or 0,
        return_us=_microseconds(return_after),
        repair_us=_microseconds(repair_after),
    )


def _microseconds(seconds: float | None) -> int | None:
    return None if seconds is None else max(1, round(seconds * 1e6))
