"""`mrbt sim run`: missions in virtual time."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, CommandGroup, FiniteNumber, refuse, used
from mrbt_mesh.cli.commands.chaos import chaos
from mrbt_mesh.cli.commands.estimate import estimate
from mrbt_mesh.cli.options import (
    FAULTS,
    fault_options,
    json_option,
    optional_mission_argument,
    program_option,
    robots_option,
    seed_option,
    solver_option,
    speed_option,
    virtual_timeout_option,
)
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.sim.world.network import NetworkKnobs


@click.group(cls=CommandGroup)
def sim() -> None:
    """Run missions in virtual time: once, with random faults, or for statistics.

    Example: mrbt sim run examples/vehicle_repair/mission.yaml --kill A1@12.5
    """


share_option = partial(click.option, type=FiniteNumber(0, 1), default=0.0)


@sim.command()
@optional_mission_argument
@seed_option
@robots_option
@program_option
@solver_option
@virtual_timeout_option
@speed_option
@fault_options(*FAULTS)
@share_option("--loss", help="Share of messages that are lost.")
@share_option("--duplicate", help="Share of messages that come twice.")
@share_option("--reorder", help="Share of messages that others overtake.")
@click.option(
    "--noise",
    type=FiniteNumber(0, 0.999),
    default=0.0,
    help="Share by which works and travel times vary at most.",
)
@click.option("--delay-ms", type=FiniteNumber(0), default=1.0, help="Delay of a message.")
@click.option(
    "--jitter-ms", type=FiniteNumber(0), default=1.0, help="Random extra delay up to this value."
)
@click.option(
    "--schedule",
    type=PATH,
    metavar="FILE",
    help="Faults and network as `mrbt sim chaos` wrote them.",
)
@click.option("--events", type=PATH, metavar="FILE", help="Write the robots' actions (JSON lines).")
@click.option("--log", type=PATH, metavar="FILE", help="Write every effect of every agent.")
@click.option("--record", type=PATH, metavar="DIR", help="Record all that robots know and do.")
@json_option
def run(
    *,
    mission: Path | None,
    seed: int,
    robots: str | None,
    program: str | None,
    solver: str | None,
    timeout: float,
    speed: float,
    noise: float,
    schedule: Path | None,
    events: Path | None,
    log: Path | None,
    record: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Run a mission once in virtual time, with the faults that you name.

    Seconds of work take milliseconds, and the same options give the same run, byte for byte. Agents
    and robots' programs are the real ones, and the invariants are checked. Times count from the
    launch of the team.

    Exit status: 0 the mission succeeded, 1 it failed or an invariant broke, 2 bad input, 3 not
    finished in time, or blocked at the end. Of a mission that never ends, the last complete round
    counts.

    \b
    Example: mrbt sim run examples/vehicle_repair/mission.yaml --kill A1@12.5 --loss 0.1
             mrbt sim run --schedule chaos-failures/seed-17-minimised.json
    """
    from mrbt_mesh.cli.options import checked_program, chosen_robots
    from mrbt_mesh.cli.terminal import check_new_folder, check_outputs
    from mrbt_mesh.cli.virtual.named_faults import read_faults
    from mrbt_mesh.cli.virtual.one_run import RunFiles, run_and_print
    from mrbt_mesh.cli.virtual.replay import read_schedule
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.program_loader import load_program
    from mrbt_mesh.runtime.solver_loader import solver_for
    from mrbt_mesh.sim.run import run_scenario, simulate
    from mrbt_mesh.sim.world.named_faults import check_faults
    from mrbt_mesh.sim.world.setup import AgentOptions

    check_outputs(mission, {"--events": events, "--log": log})
    check_new_folder("--record", record)
    files = RunFiles(events, log, record)
    if schedule is not None:
        own = {"MISSION", "--schedule", "--program", "--json", "--events", "--log", "--record"}
        refuse("not with --schedule, whose file has it", *({*used()} - own))
        read = read_schedule(schedule, mission, program)
        run_and_print(partial(run_scenario, *read), (), files, as_json)
    if mission is None:
        raise InputError("give a MISSION, or the --schedule of a run to repeat")
    loaded = load_mission(mission)
    team = chosen_robots("--robots", robots, loaded)
    named = read_faults(loaded, {f"--{kind}": options.pop(kind) for kind in FAULTS})
    check_faults(named, team, timeout)
    once = partial(
        simulate,
        loaded,
        load_program(checked_program(loaded, team, program)),
        seed=seed,
        robots=team,
        schedule=[(fault.at_us, fault.fault) for fault in named],
        network=_knobs(**options),
        timeout_us=round(timeout * 1e6),
        speed=speed,
        noise_permille=round(noise * 1_000),
        agents=AgentOptions(solver=solver_for(loaded, solver)),
    )
    run_and_print(once, named, files, as_json)


def _knobs(
    loss: float, duplicate: float, reorder: float, delay_ms: float, jitter_ms: float
) -> NetworkKnobs:
    """Convert to the simulator's units. Raises InputError for shares not in steps of 0.001."""
    from mrbt_mesh.sim.world.network import LinkKnobs, NetworkKnobs

    permille = {}
    for option, value in {
        "loss": loss,
        "duplicate": duplicate,
        "reorder": reorder,
        "delay-ms": delay_ms,
        "jitter-ms": jitter_ms,
    }.items():
        permille[option] = round(value * 1_000)
        if abs(value * 1_000 - permille[option]) > 1e-6 * max(1.0, value):
            raise InputError(f"--{option} {value:g}: in steps of 0.001")
    return NetworkKnobs(
        LinkKnobs(
            delay_us=permille["delay-ms"],
            jitter_us=permille["jitter-ms"],
            loss_permille=permille["loss"],
            duplicate_permille=permille["duplicate"],
            reorder_permille=permille["reorder"],
        )
    )


sim.add_command(chaos)
sim.add_command(estimate)
