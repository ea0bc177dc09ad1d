"""`mrbt sim estimate`: how likely a mission succeeds, by many runs with random failures."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
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
    virtual_timeout_option,
)
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.sim.world.setup import Rate

_rate = partial(click.option, multiple=True, metavar="[WHO:]P[/action|/hour]")
_seconds = partial(click.option, type=FiniteNumber(0, min_open=True), metavar="SECONDS")


@click.command(cls=MrbtCommand)
@mission_argument
@_rate("--fault-rate", help="Robots die: a chance per completed action, or a number per hour.")
@_rate("--minor-rate", help="Robots lose a capability, likewise.")
@_rate("--failure-rate", metavar="[LOCAL_TASK:]P", help="Actions fail with this probability.")
@_seconds("--return-after", help="Dead robots are restarted.")
@_seconds("--repair-after", help="Lost capabilities come back.")
@click.option("--runs", type=click.IntRange(1), default=1_000, metavar="N", help="Number of runs.")
@seed_option
@jobs_option
@virtual_timeout_option
@program_option
@json_option
def estimate(
    mission: Path,
    fault_rate: tuple[str, ...],
    minor_rate: tuple[str, ...],
    failure_rate: tuple[str, ...],
    return_after: float | None,
    repair_after: float | None,
    runs: int,
    seed: int,
    jobs: int | None,
    timeout: float,
    program: str | None,
    as_json: bool,
) -> None:
    """Estimate how likely a mission succeeds and how long it takes when robots fail by chance.

    Makes many runs of the same agents in virtual time, each with a seed of its own. A run that can
    never go on is ended early, as blocked. The same options and seed print the same figures,
    whatever --jobs. WHO is a robot or a robot type; without it, all robots.

    Exit status: 0 the runs were made, 1 an agent or a program broke, 2 bad input, 3 interrupted.

    \b
    Example: mrbt sim estimate MISSION --fault-rate 0.05/action
             mrbt sim estimate MISSION --fault-rate A:2/hour --repair-after 30
    """
    from mrbt_mesh.cli.options import checked_program
    from mrbt_mesh.cli.terminal import console, print_json, table, with_bar
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.solver_loader import solver_for
    from mrbt_mesh.sim.estimate import Experiment, outcomes, summarise
    from mrbt_mesh.sim.run import SimulationError
    from mrbt_mesh.sim.world.setup import FailureModel

    if not fault_rate:
        refuse("no robot dies: see --fault-rate", "--return-after")
    if not minor_rate:
        refuse("no capability is lost: see --minor-rate", "--repair-after")
    loaded = load_mission(mission)
    solver_for(loaded)
    who = [*sorted(loaded.robots), *sorted({robot.type for robot in loaded.robots.values()})]
    actions = _read("--failure-rate", failure_rate, sorted(loaded.local_tasks), ("",))
    failures = FailureModel(
        major=_read("--fault-rate", fault_rate, who),
        minor=_read("--minor-rate", minor_rate, who),
        actions={name: rate.per_action for name, rate in actions.items()},
        return_us=max(1, round(return_after * 1e6)) if return_after else None,
        repair_us=max(1, round(repair_after * 1e6)) if repair_after else None,
    )
    named = str(mission), checked_program(loaded, sorted(loaded.robots), program)
    experiment = Experiment(*named, failures, runs, seed, round(timeout * 1e6))
    try:
        ends = outcomes(experiment, jobs or os.cpu_count() or 1)
        found, interrupted = with_bar("estimate", ends, runs)
    except SimulationError as error:
        fail(str(error), FAILURE)
    figures: dict[str, Any] = summarise(found) if found else {"runs": 0}
    if as_json:
        print_json({"mission": loaded.name, "seed": seed, "interrupted": interrupted} | figures)
    elif found:
        rows, share = table(loaded.name, f"{len(found)} runs"), figures["success"]
        between = f"{share['low']:.1%} to {share['high']:.1%} with 95 % confidence"
        rows.add_row("success", f"{share['probability']:.1%} ({between})")
        rows.add_row("results", ", ".join(f"{n} {name}" for name, n in figures["results"].items()))
        for name, value in (figures["duration_s"] or {}).items():
            rows.add_row(f"{name} of the time", f"{value:.2f} s")
        console.print(rows)
    if interrupted:
        fail("interrupted", NOT_FINISHED)


def _read(
    option: str,
    texts: Sequence[str],
    known: Sequence[str],
    units: Sequence[str] = ("", "action", "hour"),
) -> dict[str, Rate]:
    """Parse rates by name, or by EVERYBODY, from texts like `0.1`, `A1:0.1/action`, `2/hour`."""
    from mrbt_mesh.sim.world.setup import Rate

    found: dict[str, Rate] = {}
    for text in texts:
        name, _, number = text.rpartition(":")
        digits, _, unit = number.partition("/")
        try:
            value = float(digits)
        except ValueError:
            value = math.nan
        if name and name not in known:
            raise InputError(f"{option} {text}: {name!r} is none of {', '.join(known)}")
        if name in found:
            raise InputError(f"{option} {text}: a rate was given for {name or 'all'} before")
        if not 0 <= value < math.inf or unit not in units:
            raise InputError(f"{option} {text}: expected e.g. 0.1 or, of robots, 2/hour")
        if unit != "hour" and value > 1:
            raise InputError(f"{option} {text}: a chance is from 0 to 1")
        found[name] = Rate(per_hour=value) if unit == "hour" else Rate(per_action=value)
    return found
