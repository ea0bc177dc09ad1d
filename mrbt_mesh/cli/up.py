"""`mrbt up` and `mrbt watch`: start a team, watch it, tell how it went.

The observer decides nothing: with `--detach` the team runs without it.
"""

from __future__ import annotations

import contextlib
import json
import signal
from collections.abc import AsyncIterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import anyio
import typer
from rich.live import Live

from mrbt_mesh.cli.common import (
    BAD_INPUT,
    EXIT_OF_RESULT,
    SUCCESS,
    InputError,
    JsonOption,
    MissionArgument,
    RobotsOption,
    SolverOption,
    checked_program,
    chosen_robots,
    console,
    end_process,
    errors,
    fail,
    input_errors,
    print_json,
    read_mission,
)
from mrbt_mesh.cli.live_view import render_live
from mrbt_mesh.cli.summary import render_summary
from mrbt_mesh.cli.team_options import on_a_team
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import SUMMARY_FILE, RunDir, RunInfo, state_dir, write_atomically
from mrbt_mesh.runtime.solver_loader import solver_for
from mrbt_mesh.runtime.team import Team, address_of, new_run
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching
from mrbt_mesh.runtime.zenoh_transport import TransportError

FRAME_S = 0.1
CATCH_UP_S = 1.0
STOPPED = "stopped by the operator"

SpeedOption = Annotated[
    float,
    typer.Option("--speed", min=0.01, max=1000, help="Simulated robots work this much faster."),
]
HeadlessOption = Annotated[
    bool, typer.Option("--headless", help="Lines as things happen, no live view.")
]
TimeoutOption = Annotated[
    float | None, typer.Option("--timeout", min=0, help="End the run after this many seconds.")
]


def up(
    mission: MissionArgument,
    robots: RobotsOption = None,
    run_dir: Annotated[
        Path | None, typer.Option("--run-dir", help="Folder for logs, events and the summary.")
    ] = None,
    headless: HeadlessOption = False,
    as_json: JsonOption = False,
    timeout_s: TimeoutOption = None,
    speed: SpeedOption = 1.0,
    detach: Annotated[
        bool, typer.Option("--detach", help="Start the team and leave it running.")
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the run in --run-dir, from its journals.")
    ] = False,
    program: Annotated[
        str | None, typer.Option("--program", help="Robot program FILE.py[:NAME].")
    ] = None,
    solver: SolverOption = None,
    beat_s: Annotated[float, typer.Option("--beat", help="Heartbeat period in s.")] = 0.2,
    detection_s: Annotated[
        float, typer.Option("--detection", help="Silence until a robot is dead, in s.")
    ] = 1.0,
    transport: Annotated[
        Literal["wired", "wireless"],
        typer.Option("--transport", help="How robots talk: TCP, or QUIC for lossy networks."),
    ] = "wired",
) -> None:
    """Start one process per robot and watch the mission.

    Exit status: 0 success, 1 failure, 2 bad input, 3 not finished in time, blocked, or ended
    before the team had gathered.

    Example: mrbt up examples/vehicle_repair/mission.yaml --speed 2
    """
    loaded = read_mission(mission)
    with input_errors():
        names = chosen_robots(robots, loaded)
        reference = checked_program(loaded, names, program)
        solver_for(loaded, solver)
        info = new_run(
            loaded,
            mission,
            names,
            reference,
            beat_s=beat_s,
            detection_s=detection_s,
            speed=speed,
            transport=transport,
            solver=solver,
        )
        created = _resumed(run_dir, info, loaded) if resume else _created(run_dir, info, loaded)
    with input_errors():
        code = anyio.run(_run, created, loaded, detach, _show(headless, as_json), timeout_s)
    end_process(code)


@on_a_team
def watch(
    team: TeamAddress,
    headless: HeadlessOption = False,
    as_json: JsonOption = False,
    timeout_s: TimeoutOption = None,
) -> None:
    """Watch a team that runs already, or is yet to come; ending the view leaves it alone.

    Exit status: as of `mrbt up`.

    Example: mrbt up MISSION --detach; mrbt watch
    """
    found = team.run_dir
    processes = Team(found, found.info(), team.mission) if found is not None else None
    show = _show(headless, as_json)
    if processes is None and show == "lines":
        where = f"team {team.transport.team}, run {team.run}"
        console.print(f"listening for {where}", highlight=False, soft_wrap=True)
    end_process(anyio.run(_watch, team, processes, show, timeout_s))


def _show(headless: bool, as_json: bool) -> str:
    if as_json:
        return "json"
    return "lines" if headless or not console.is_terminal else "live"


def _created(folder: Path | None, info: RunInfo, mission: Mission) -> RunDir:
    """The directory of a new run, by default one of its own in the state folder."""
    if folder is None:
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        folder = state_dir() / "runs" / f"{mission.name}-{stamp}"
    return RunDir.create(folder.resolve(), info, compile_mission(mission))


def _resumed(folder: Path | None, info: RunInfo, mission: Mission) -> RunDir:
    """The directory of an earlier run, to go on with; the run keeps its id and its team's name.

    Raises InputError if robots of it still run, or if it is a run of another mission.
    """
    if folder is None:
        raise InputError("--resume needs the --run-dir of the run to go on with")
    found = RunDir.find(folder.resolve())
    running = [robot for robot in found.robots() if found.process(robot) is not None]
    if running:
        raise InputError(f"{found.path}: {', '.join(running)} still run; see `mrbt watch`")
    if load_mission(found.mission_path).digest != mission.digest:
        raise InputError(f"{found.path} is a run of another mission, or of another version of it")
    before = found.info()
    found.save(replace(info, team=before.team, run=before.run))
    found.remember()
    return found


async def _run(
    run_dir: RunDir, mission: Mission, detach: bool, show: str, timeout_s: float | None
) -> int:
    info = run_dir.info()
    team = Team(run_dir, info, mission)
    for robot in info.robots:
        await team.start(robot)
    if detach:
        console.print(f"{mission.name}: {len(info.robots)} robots run; [bold]mrbt status[/]")
        console.print(f"run directory: {run_dir.path}", highlight=False, soft_wrap=True)
        return SUCCESS
    try:
        return await _watch(address_of(run_dir), team, show, timeout_s)
    finally:
        with anyio.CancelScope(shield=True):
            await team.end()


async def _watch(
    address: TeamAddress, team: Team | None, show: str, timeout_s: float | None
) -> int:
    """Watch until the mission is over, time is up, nobody is left, or the operator stops it.

    `team`: its processes, if they are of this machine; of others robots may yet come.
    """
    try:
        async with watching(address) as watcher:
            async with anyio.create_task_group() as group:
                if team is not None:
                    group.start_soon(team.note_exits, watcher)
                why = await _until_over(team, watcher, show, timeout_s)
                group.cancel_scope.cancel()
            return _report(team, watcher, show, why)
    except TransportError as error:
        fail(str(error))


@contextlib.asynccontextmanager
async def _display(watcher: Watcher, show: str) -> AsyncIterator[Any]:
    """A function that shows the present state: the live view, new lines, or nothing."""
    observer = watcher.observer
    if show == "live":
        with Live(console=console, screen=True, auto_refresh=False) as live:
            yield lambda: live.update(
                render_live(observer, boottime_us(), console.height), refresh=True
            )
        return
    printed = 0

    def lines() -> None:
        nonlocal printed
        for at_us, text in observer.record.timeline[printed:]:
            seconds = observer.record.seconds(at_us) or 0.0
            console.print(f"{seconds:8.2f}  {text}", highlight=False, soft_wrap=True)
        printed = len(observer.record.timeline)

    yield lines if show == "lines" else lambda: None


async def _until_over(
    team: Team | None, watcher: Watcher, show: str, timeout_s: float | None
) -> str | None:
    """Why watching ended before the mission did, or None if the mission is over."""
    deadline = anyio.current_time() + timeout_s if timeout_s is not None else float("inf")
    checked = anyio.current_time()
    stop = anyio.Event()

    async def wait_for_signal() -> None:
        with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
            async for _ in signals:
                stop.set()
                watcher.changed.set()

    async with anyio.create_task_group() as group, _display(watcher, show) as refresh:
        group.start_soon(wait_for_signal)
        why: str | None = None
        while watcher.observer.record.result is None and why is None:
            await watcher.wait_for_change(FRAME_S)
            refresh()
            now = anyio.current_time()
            if now >= deadline:
                why = "time is up"
            elif stop.is_set():
                why = STOPPED
            elif now > checked + 1:
                checked = now
                if team is not None and not team.living():
                    why = "no robot is left"
        # Who came late may know the result before what led to it.
        await watcher.catch_up(CATCH_UP_S)
        refresh()
        group.cancel_scope.cancel()
    return why


def _report(team: Team | None, watcher: Watcher, show: str, why: str | None) -> int:
    """Print the summary and write summary.json; returns the exit status."""
    refused = team.refusals() if team is not None else []
    observer = watcher.observer
    if observer.record.started_us is None and refused:
        for text in refused:
            errors.print(text, soft_wrap=True, markup=False)
        return BAD_INPUT
    now_us = boottime_us()
    if team is not None:
        result = team.result(observer, now_us)
    else:
        result = observer.result(anybody_lives=bool(observer.membership.alive_set()))
    summary = observer.record.summary(result, now_us)
    if why is not None:
        summary["ended_because"] = why
    if team is not None:
        summary["run_dir"] = str(team.run_dir.path)
        write_atomically(team.run_dir.path / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
    if show == "json":
        print_json(summary)
    else:
        console.print(render_summary(summary))
    for text in refused:
        errors.print(text, soft_wrap=True, markup=False)
    return EXIT_OF_RESULT[result]
