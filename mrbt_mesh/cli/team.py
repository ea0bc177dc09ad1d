"""Commands on a running team: faults from outside, joining, leaving, orders, status."""

from __future__ import annotations

import signal
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any

import anyio
import psutil
import typer
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.common import (
    FAILURE,
    InputError,
    JsonOption,
    RunDirOption,
    console,
    end_process,
    fail,
    input_errors,
    print_json,
)
from mrbt_mesh.cli.live_view import STATE_STYLES
from mrbt_mesh.core.commands import DECIDE, FAULT, LEAVE, ORDER, RESTORE, Decision
from mrbt_mesh.core.membership import State
from mrbt_mesh.core.mission import is_robot_id
from mrbt_mesh.core.observer import Observer
from mrbt_mesh.core.timing import SECOND_US
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team, watching_run
from mrbt_mesh.runtime.watcher import Watcher
from mrbt_mesh.runtime.zenoh_transport import TransportError

CONNECT_TIMEOUT_S = 3.0
SETTLE_BEATS = 2

RobotArgument = Annotated[str, typer.Argument(help="A robot's id.", metavar="ROBOT")]


# -- faults from outside ------------------------------------------------------------------


def _signal(robot: str, run_dir: Path | None, number: signal.Signals, done: str) -> None:
    with input_errors():
        found = RunDir.find(run_dir)
        process = found.process(robot)
        if process is None:
            known = ", ".join(found.robots()) or "none"
            raise InputError(f"no process of robot {robot} runs in {found.path} (robots: {known})")
    try:
        process.send_signal(number)
    except psutil.Error as error:
        fail(f"cannot signal {robot} (pid {process.pid}): {error}", FAILURE)
    console.print(f"{robot} (pid {process.pid}) {done}", highlight=False)


def kill(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Kill a robot's process with SIGKILL: a major fault.

    Example: mrbt kill A1
    """
    _signal(robot, run_dir, signal.SIGKILL, "killed")


def freeze(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Freeze a robot's process with SIGSTOP: it falls silent, but its links stay up.

    Example: mrbt freeze A1
    """
    _signal(robot, run_dir, signal.SIGSTOP, "frozen")


def thaw(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Let a frozen robot go on with SIGCONT.

    Example: mrbt thaw A1
    """
    _signal(robot, run_dir, signal.SIGCONT, "goes on")


# -- words to robots ----------------------------------------------------------------------


async def _with_team(run_dir: RunDir, act: Callable[[Watcher], Awaitable[int]]) -> int:
    """Attach to the team of a run, and act once a robot is heard."""
    info = run_dir.info()
    mission = load_mission(run_dir.mission_path)
    async with watching_run(run_dir, info, mission) as watcher:
        with anyio.move_on_after(CONNECT_TIMEOUT_S):
            while not _caught_up(watcher.observer):
                await watcher.wait_for_change(info.beat_s)
        return await act(watcher)


def _caught_up(observer: Observer) -> bool:
    """Whether this observer has heard a robot and holds the same facts as all that it hears."""
    beats = [p.beat for p in observer.membership.peers.values() if p.beat and p.joined]
    digest = observer.facts.map.digest()
    return bool(beats) and all(beat.fact_digest == digest for beat in beats)


def _command(run_dir: Path | None, robot: str | None, command: str, argument: str = "") -> None:
    async def act(watcher: Watcher) -> int:
        target = robot
        if target is None:
            living = list(watcher.observer.membership.alive())
            if not living:
                fail("no robot answers", FAILURE)
            target = living[0]
        good, text = await watcher.command(target, command, argument)
        if not good:
            fail(text, FAILURE)
        console.print(text, highlight=False)
        return 0

    with input_errors():
        found = RunDir.find(run_dir)
        if robot is not None and robot not in found.robots():
            known = ", ".join(found.robots()) or "none"
            raise InputError(f"no robot {robot} in {found.path} (robots: {known})")
        try:
            code = anyio.run(_with_team, found, act)
        except TransportError as error:
            raise InputError(str(error)) from error
    end_process(code)


def fault(
    robot: RobotArgument,
    lose: Annotated[
        str, typer.Option("--lose", help="Local task that the robot can no longer do, or `all`.")
    ],
    run_dir: RunDirOption = None,
) -> None:
    """A minor fault: a robot loses a capability.

    Example: mrbt fault A1 --lose replace_hw
    """
    _command(run_dir, robot, FAULT, lose)


def restore(
    robot: RobotArgument,
    local_task: Annotated[
        str, typer.Argument(help="Local task; default: all that are lost.")
    ] = "all",
    run_dir: RunDirOption = None,
) -> None:
    """A robot can do again what it had lost.

    Example: mrbt restore A1 replace_hw
    """
    _command(run_dir, robot, RESTORE, local_task)


def leave(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """A robot leaves on purpose: its work is handed over at once.

    Example: mrbt leave B1
    """
    _command(run_dir, robot, LEAVE)


def pause(run_dir: RunDirOption = None) -> None:
    """Stop all work until `mrbt resume`.

    Example: mrbt pause
    """
    _command(run_dir, None, ORDER, "pause")


def resume(run_dir: RunDirOption = None) -> None:
    """Go on after `mrbt pause`.

    Example: mrbt resume
    """
    _command(run_dir, None, ORDER, "resume")


def abort(run_dir: RunDirOption = None) -> None:
    """End the mission as failed. It cannot be taken back.

    Example: mrbt abort
    """
    _command(run_dir, None, ORDER, "abort")


def decide(
    global_task: Annotated[str, typer.Argument(help="An exclusive task that is in doubt.")],
    decision: Annotated[Decision, typer.Argument(help="What became of it.")],
    run_dir: RunDirOption = None,
) -> None:
    """Say how an exclusive task goes on whose robot vanished in the middle of it.

    `done` and `failed` say how it ended; `retry` has it done again from the beginning.

    Example: mrbt decide "dose(2)" done
    """
    _command(run_dir, None, DECIDE, f"{global_task} {decision}")


# -- joining ------------------------------------------------------------------------------


def join(
    robot: RobotArgument,
    robot_type: Annotated[
        str | None, typer.Option("--type", help="Its type, if the mission does not list it.")
    ] = None,
    takeover: Annotated[
        bool, typer.Option("--takeover", help="Replace a live robot of the same id.")
    ] = False,
    run_dir: RunDirOption = None,
) -> None:
    """Start one more robot of the running mission, or a dead one again.

    Example: mrbt join C1
    """
    with input_errors():
        found = RunDir.find(run_dir)
        info = found.info()
        mission = load_mission(found.mission_path)
        if not is_robot_id(robot):
            raise InputError(f"robot id {robot!r}: 1 to 32 letters, digits, '_' or '-'")
        if robot not in mission.robots and robot_type not in mission.robot_types:
            types = ", ".join(sorted(mission.robot_types))
            raise InputError(f"the mission has no robot {robot}: give its --type ({types})")
        running = found.process(robot)
        if running is not None and not takeover:
            raise InputError(
                f"robot {robot} is already running (pid {running.pid}): stop it first, "
                "or replace it with --takeover"
            )
        team = Team(found, info, mission)

    async def start() -> int | None:
        process = await team.start(robot, robot_type=robot_type, takeover=takeover)
        with anyio.move_on_after(2 * info.detection_s):
            return await process.wait()
        return None

    with input_errors():
        code = anyio.run(start)
    if code is not None and code != 0:
        fail((found.path / f"{robot}.out").read_text().strip().rpartition("\n")[2], code)
    console.print(f"{robot} joined", highlight=False)


# -- status -------------------------------------------------------------------------------


def status(as_json: JsonOption = False, run_dir: RunDirOption = None) -> None:
    """Who does what, what is blocked, and whether all agree.

    Example: mrbt status --json
    """
    with input_errors():
        found = RunDir.find(run_dir)

        async def act(watcher: Watcher) -> int:
            # Two beats tell who is silent, and what the others say of it.
            with anyio.move_on_after(SETTLE_BEATS * watcher.timing.beat_us / SECOND_US):
                while True:
                    await watcher.wait_for_change(0.05)
            watcher.refresh()
            data = status_data(found, watcher.observer)
            if as_json:
                print_json(data)
            else:
                _print_status(data)
            return 0

        summary = found.summary()
        if summary is not None and not any(found.process(robot) for robot in found.robots()):
            if as_json:
                print_json(_final_status(summary))
            else:
                console.print(f"the run is over: {summary['result']}", highlight=False)
            raise typer.Exit(0)
        try:
            code = anyio.run(_with_team, found, act)
        except TransportError as error:
            raise InputError(str(error)) from error
    end_process(code)


def _final_status(summary: dict[str, Any]) -> dict[str, Any]:
    """The status of a run that has ended, with the keys of a running one."""
    robots = {
        robot: {**row, "pid": None, "local_task": None} for robot, row in summary["robots"].items()
    }
    return {**summary, "over": True, "robots": robots, "blocked": [], "agreement": True}


def status_data(run_dir: RunDir, observer: Observer) -> dict[str, Any]:
    """The status as plain data."""
    robots: dict[str, Any] = {}
    for robot in sorted({*observer.robots(), *run_dir.robots()}):
        member = observer.facts.members.get(robot)
        claim = observer.claim(robot)
        process = run_dir.process(robot)
        state = observer.robot_state(robot)
        if process is None and state in (State.ALIVE, State.SUSPECT):
            # Its own record says it is gone, and nobody has heard it since.
            state = state if robot not in run_dir.robots() else State.SUSPECT
        robots[robot] = {
            "pid": process.pid if process else None,
            "state": str(state),
            "type": member[0].type if member else None,
            "local_task": claim.local_task if claim else None,
            "global_task": claim.global_task if claim else None,
            "phase": claim.phase.name.lower() if claim else None,
            "lost": list(member[0].lost) if member else [],
        }
    plan = observer.plan
    working: dict[str, list[str]] = {}
    for robot, row in robots.items():
        if row["global_task"]:
            working.setdefault(row["global_task"], []).append(robot)
    return {
        "mission": observer.mission.name,
        "result": plan.result.name.lower() if plan else None,
        "robots": robots,
        "global_tasks": {
            name: {"status": task.status.name.lower(), "robots": working.get(name, [])}
            for name, task in observer.record.tasks.items()
        },
        "blocked": [
            {"request": w.global_task, "reason": w.reason}
            for w in (plan.waiting if plan else ())
            if w.is_blocked
        ],
        "waiting": [w.global_task for w in (plan.waiting if plan else ()) if not w.is_blocked],
        "agreement": observer.agreement,
        "run_dir": str(run_dir.path),
    }


def _print_status(data: dict[str, Any]) -> None:
    table = Table("robot", "type", "pid", "state", "works on", "lost", box=None, header_style="dim")
    for robot, row in data["robots"].items():
        table.add_row(
            Text(robot, style="bold"),
            row["type"] or "",
            str(row["pid"] or ""),
            Text(row["state"], style=STATE_STYLES[State(row["state"])]),
            row["local_task"] or Text("nothing", style="dim"),
            Text(", ".join(row["lost"]), style="red"),
        )
    console.print(f"[bold]{data['mission']}[/]: {data['result']}", highlight=False)
    console.print(table)
    by_status: dict[str, list[str]] = {}
    for name, task in data["global_tasks"].items():
        by_status.setdefault(task["status"], []).append(name)
    for name in ("running", "success", "failure"):
        if by_status.get(name):
            listed = ", ".join(by_status[name])
            console.print(f"[dim]{name}:[/] {listed}", highlight=False, soft_wrap=True)
    for row in data["blocked"]:
        console.print(f"[red]{row['request']} {row['reason']}[/]", highlight=False)
    console.print("all agree" if data["agreement"] else "[yellow]the robots are agreeing[/]")
