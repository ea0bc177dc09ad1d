"""`mrbt sim`: a mission in virtual time, with a network and robots that fail on schedule."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from mrbt_mesh.cli.chaos import Options, make_source, parse_seeds, read_schedule, run_chaos
from mrbt_mesh.cli.common import (
    EXIT_OF_RESULT,
    FAILURE,
    InputError,
    JsonOption,
    RobotsOption,
    SolverOption,
    checked_program,
    chosen_robots,
    console,
    errors,
    fail,
    input_errors,
    print_json,
    read_mission,
)
from mrbt_mesh.cli.summary import render_summary
from mrbt_mesh.core.mission.mission import Mission, performance, type_name
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.runtime.solver_loader import solver_for
from mrbt_mesh.sim.chaos.generate import PROGRAM, generate_mission
from mrbt_mesh.sim.engine import faults
from mrbt_mesh.sim.engine.network import LinkKnobs, NetworkKnobs
from mrbt_mesh.sim.run import SimulationError, SimulationResult, run_scenario, simulate

_WHEN = re.compile(r"(?P<what>[^@]+)@(?P<at_s>\d+(?:\.\d+)?)")
_TIMES = "robot@seconds; repeat it or separate with commas"


OptionalMissionArgument = Annotated[
    Path | None, typer.Argument(help="Mission file (.yaml).", metavar="MISSION")
]
Times = list[str] | None
KillOption = Annotated[Times, typer.Option(metavar="A1@12.5,...", help=f"SIGKILL: {_TIMES}.")]
RestartOption = Annotated[Times, typer.Option(metavar="A1@14,...", help="Start it again.")]
FreezeOption = Annotated[Times, typer.Option(metavar="A1@3,...", help="SIGSTOP.")]
ThawOption = Annotated[Times, typer.Option(metavar="A1@8,...", help="SIGCONT.")]
LeaveOption = Annotated[Times, typer.Option(metavar="B1@6,...", help="Leave on purpose.")]
FaultOption = Annotated[
    Times, typer.Option(metavar="A1:LOCAL_TASK@4,...", help="Lose a capability, or all of them.")
]
RestoreOption = Annotated[
    Times, typer.Option(metavar="A1[:LOCAL_TASK]@6,...", help="Have it again.")
]
EventsOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write what the robots did, as JSON lines.")
]
LogOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write every effect of every agent.")
]
ProgramOption = Annotated[
    str | None, typer.Option(metavar="FILE[:NAME]", help="Default: the mission's program.")
]

_CHAOS = "Chaos: random faults"
ChaosOption = Annotated[
    bool, typer.Option("--chaos", rich_help_panel=_CHAOS, help="Random faults, for many seeds.")
]
SeedsOption = Annotated[
    str, typer.Option(metavar="FIRST:END", rich_help_panel=_CHAOS, help="The seeds of --chaos.")
]
MinutesOption = Annotated[
    float | None,
    typer.Option(rich_help_panel=_CHAOS, help="Instead: all seeds from FIRST on, for this long."),
]
JobsOption = Annotated[
    int, typer.Option(min=1, rich_help_panel=_CHAOS, help="In so many processes.")
]
GeneratedOption = Annotated[
    bool,
    typer.Option(
        "--generated", rich_help_panel=_CHAOS, help="No MISSION: a random one for each seed."
    ),
]
KeepOption = Annotated[
    Path,
    typer.Option(metavar="DIR", rich_help_panel=_CHAOS, help="What fails is written there."),
]
MinimiseOption = Annotated[
    float,
    typer.Option(
        metavar="SECONDS", rich_help_panel=_CHAOS, help="Time to cut down a failing schedule."
    ),
]
ScheduleOption = Annotated[
    Path | None,
    typer.Option(
        "--schedule", metavar="FILE", rich_help_panel=_CHAOS, help="Replay what --chaos wrote."
    ),
]


def sim(
    mission: OptionalMissionArgument = None,
    seed: Annotated[int, typer.Option(help="The same seed gives the same run.")] = 0,
    robots: RobotsOption = None,
    program: ProgramOption = None,
    solver: SolverOption = None,
    kill: KillOption = None,
    restart: RestartOption = None,
    freeze: FreezeOption = None,
    thaw: ThawOption = None,
    leave: LeaveOption = None,
    fault: FaultOption = None,
    restore: RestoreOption = None,
    loss: Annotated[float, typer.Option(help="Messages lost, 0 to 1.")] = 0.0,
    duplicate: Annotated[float, typer.Option(help="Messages doubled, 0 to 1.")] = 0.0,
    reorder: Annotated[float, typer.Option(help="Messages overtaken by others, 0 to 1.")] = 0.0,
    delay_ms: Annotated[float, typer.Option(help="Time that a message takes.")] = 1.0,
    jitter_ms: Annotated[float, typer.Option(help="Up to this much more.")] = 1.0,
    timeout: Annotated[float, typer.Option(help="Virtual seconds until it is given up.")] = 600.0,
    speed: Annotated[float, typer.Option(help="Robots work this many times faster.")] = 1.0,
    events: EventsOption = None,
    log: LogOption = None,
    chaos: ChaosOption = False,
    seeds: SeedsOption = "0:100",
    minutes: MinutesOption = None,
    jobs: JobsOption = 1,
    generated: GeneratedOption = False,
    keep: KeepOption = Path("chaos-failures"),
    minimise: MinimiseOption = 60.0,
    schedule_file: ScheduleOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run a mission in virtual time: seconds of work in milliseconds, the same for the same seed.

    One run, with the faults that you name. (`mrbt simulate` makes many, with faults by chance, and
    tells how likely the mission succeeds.)

    Times count from the launch of the team. Exit status: 0 the mission succeeded, 1 it failed,
    2 bad input, 3 not finished in time or blocked at the end.

    With --chaos, every seed draws its own faults (crashes, partitions, loss, slow robots, skewed
    clocks and more) and what must always hold is checked: exit status 1 if anything did not. A
    failure is written to --keep, cut down to the faults that it takes.

    Example: mrbt sim examples/vehicle_repair/mission.yaml --seed 7 --kill A1@12.5
    --freeze B1@3 --thaw B1@8 --loss 0.1

    Example: mrbt sim --generated --chaos --seeds 0:1000 --jobs 2

    Example: mrbt sim --schedule chaos-failures/seed-17-minimised.json
    """
    output = Output(events, log, as_json)
    with input_errors():
        _check_mode(mission, generated, chaos, schedule_file)
    if chaos:
        with input_errors():
            source = make_source(mission, program, speed)
            numbers = parse_seeds(seeds)
        run_chaos(Options(mission, source, numbers, jobs, keep, minimise, as_json, minutes))
    if schedule_file is not None:
        with input_errors():
            replayed = read_schedule(schedule_file, mission, program)
        _finish(partial(run_scenario, *replayed), output)
    model, code = _load(mission, program, robots, seed)
    with input_errors():
        schedule = [
            *_faults(model, kill, faults.Kill),
            *_faults(model, restart, faults.Restart),
            *_faults(model, freeze, faults.Freeze),
            *_faults(model, thaw, faults.Thaw),
            *_faults(model, leave, faults.Leave),
            *_minor_faults(model, fault, faults.Lose),
            *_minor_faults(model, restore, faults.Restore),
        ]
        network = _network(loss, duplicate, reorder, delay_ms, jitter_ms)
        team = chosen_robots(robots, model)
        chosen = solver_for(model, solver)
        if not timeout > 0 or not speed > 0:
            raise InputError("--timeout and --speed are above 0")
    run = partial(
        simulate,
        model,
        code,
        seed=seed,
        robots=team,
        schedule=schedule,
        network=network,
        timeout_us=round(timeout * 1e6),
        speed=speed,
        solver=chosen,
    )
    _finish(run, output)


def _check_mode(mission: Path | None, generated: bool, chaos: bool, schedule: Path | None) -> None:
    if mission is not None and generated:
        raise InputError("give a MISSION or --generated, not both")
    if mission is None and not generated and schedule is None:
        raise InputError("give a MISSION, or --generated for random ones")
    if chaos and schedule is not None:
        raise InputError("--chaos draws schedules, --schedule replays one; give one of them")


def _load(
    mission: Path | None, program: str | None, robots: str | None, seed: int
) -> tuple[Mission, RobotProgram]:
    """The mission and its robots' program; None: the generated one of this seed."""
    if mission is None:
        return generate_mission(seed).mission, PROGRAM
    model = read_mission(mission)
    with input_errors():
        return model, load_program(checked_program(model, chosen_robots(robots, model), program))


@dataclass(frozen=True)
class Output:
    """Where the events and the effects of a run go, and how its end is told."""

    events: Path | None
    log: Path | None
    as_json: bool


def _finish(run: Callable[..., SimulationResult], output: Output) -> NoReturn:
    try:
        result = run(keep_log=output.log is not None)
    except SimulationError as error:
        fail(str(error), FAILURE)
    _write_files(result, output)
    _show(result, output.as_json)


def _show(result: SimulationResult, as_json: bool) -> NoReturn:
    if as_json:
        extra = {"effect_log_digest": result.effect_log_digest, "seed": result.seed}
        print_json({**result.summary, **extra, "violations": result.violations})
    else:
        console.print(render_summary(result.summary))
        console.print(f"[dim] seed {result.seed}, effect log {result.effect_log_digest}[/]")
    for violation in result.violations:
        errors.print(f"[bold red]invariant violated:[/] seed {result.seed}: {violation}")
    raise typer.Exit(FAILURE if result.violations else EXIT_OF_RESULT[result.result])


def _write_files(result: SimulationResult, output: Output) -> None:
    try:
        if output.events is not None:
            result.write_events(output.events)
        if output.log is not None:
            lines = "".join(f"{line}\n" for line in result.effect_log)
            output.log.write_text(lines, encoding="utf-8")
    except OSError as error:
        fail(f"{error.filename}: cannot be written: {error.strerror}")


def _network(
    loss: float, duplicate: float, reorder: float, delay_ms: float, jitter_ms: float
) -> NetworkKnobs:
    for name, chance in (("loss", loss), ("duplicate", duplicate), ("reorder", reorder)):
        if not 0 <= chance <= 1:
            raise InputError(f"--{name} {chance:g}: a chance is from 0 to 1")
    if not (0 <= delay_ms < 1e6 and 0 <= jitter_ms < 1e6):
        raise InputError("--delay-ms and --jitter-ms are 0 or more, and below 1000000")
    return NetworkKnobs(
        LinkKnobs(
            delay_us=round(delay_ms * 1_000),
            jitter_us=round(jitter_ms * 1_000),
            loss_permille=round(loss * 1_000),
            duplicate_permille=round(duplicate * 1_000),
            reorder_permille=round(reorder * 1_000),
        )
    )


def _times(mission: Mission, texts: Times) -> Iterator[tuple[int, str, str]]:
    """(at_us, robot, local task or nothing) for each `ROBOT[:LOCAL_TASK]@SECONDS`."""
    for part in (part.strip() for text in texts or () for part in re.split(r",(?![^(]*\))", text)):
        match = _WHEN.fullmatch(part)
        if match is None:
            raise InputError(f"{part!r}: expected ROBOT@SECONDS, e.g. A1@12.5")
        robot, _, local_task = match["what"].partition(":")
        if robot not in mission.robots:
            raise InputError(f"{part!r}: no robot {robot!r} ({', '.join(sorted(mission.robots))})")
        yield round(float(match["at_s"]) * 1e6), robot, local_task


def _faults(
    mission: Mission, texts: Times, make: Callable[[str], faults.Fault]
) -> Iterator[tuple[int, faults.Fault]]:
    for at_us, robot, local_task in _times(mission, texts):
        if local_task:
            raise InputError(f"{robot}:{local_task}: only --fault and --restore name a task")
        yield at_us, make(robot)


def _minor_faults(
    mission: Mission, texts: Times, make: Callable[[str, str], faults.Fault]
) -> Iterator[tuple[int, faults.Fault]]:
    for at_us, robot, local_task in _times(mission, texts):
        if not local_task and make is faults.Lose:
            raise InputError(f"--fault {robot}: which local task? e.g. {robot}:all@4")
        own = mission.robots[robot].capabilities
        known = {type_name(name) for name in own}
        able = performance(own, local_task) is not None or type_name(local_task) in known
        if local_task and local_task != "all" and not able:
            raise InputError(f"{robot} has no local task {local_task!r} ({', '.join(sorted(own))})")
        yield at_us, make(robot, local_task or "all")
