"""Commands on a running team: faults from outside, joining, leaving, orders, status."""

from __future__ import annotations

import signal
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Annotated, Any, NoReturn

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
from mrbt_mesh.cli.team_options import on_a_team
from mrbt_mesh.core.agent.commands import DECIDE, FAULT, LEAVE, ORDER, RESTORE, Decision
from mrbt_mesh.core.membership.membership import State
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import is_robot_id
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team, address_of
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching
from mrbt_mesh.runtime.zenoh_transport import TransportError

CONNECT_TIMEOUT_S = 10.0
JOIN_TIMEOUT_S = 30.0
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


def _with_team(team: TeamAddress, act: Callable[[Watcher], Awaitable[int]]) -> NoReturn:
    """Attach to a team, act once a robot is heard, and end the process with what comes back."""

    async def attach() -> int:
        async with watching(team) as watcher:
            await watcher.catch_up(CONNECT_TIMEOUT_S)
            return await act(watcher)

    try:
        code = anyio.run(attach)
    except TransportError as error:
        fail(str(error))
    end_process(code)


def _command(team: TeamAddress, robot: str | None, command: str, argument: str = "") -> NoReturn:
    async def act(watcher: Watcher) -> int:
        living = list(watcher.observer.membership.alive_set())
        if not living:
            fail(_nobody(watcher), FAILURE)
        if robot is not None and robot not in watcher.observer.robots():
            fail(f"the team has no robot {robot} ({', '.join(watcher.observer.robots())})")
        good, text = await watcher.command(robot or living[0], command, argument)
        if not good:
            fail(text, FAILURE)
        console.print(text, highlight=False)
        return 0

    _with_team(team, act)


def _nobody(watcher: Watcher) -> str:
    """Why nobody is heard, as far as it can be told."""
    team = watcher.address
    text = f"no robot of team {team.transport.team}, run {team.run}, answers"
    refused = watcher.observer.refused
    return "; ".join([text, *(f"{robot}: {refused[robot]}" for robot in sorted(refused))])


@on_a_team
def fault(
    team: TeamAddress,
    robot: RobotArgument,
    lose: Annotated[
        str, typer.Option("--lose", help="Local task that the robot can no longer do, or `all`.")
    ],
) -> None:
    """A minor fault: a robot loses a capability.

    Example: mrbt fault A1 --lose replace_hw
    """
    _command(team, robot, FAULT, lose)


@on_a_team
def restore(
    team: TeamAddress,
    robot: RobotArgument,
    local_task: Annotated[
        str, typer.Argument(help="Local task; default: all that are lost.")
    ] = "all",
) -> None:
    """A robot can do again what it had lost.

    Example: mrbt restore A1 replace_hw
    """
    _command(team, robot, RESTORE, local_task)


@on_a_team
def leave(team: TeamAddress, robot: RobotArgument) -> None:
    """A robot leaves on purpose: its work is handed over at once.

    Example: mrbt leave B1
    """
    _command(team, robot, LEAVE)


@on_a_team
def pause(team: TeamAddress) -> None:
    """Stop all work until `mrbt resume`.

    Example: mrbt pause
    """
    _command(team, None, ORDER, "pause")


@on_a_team
def resume(team: TeamAddress) -> None:
    """Go on after `mrbt pause`.

    Example: mrbt resume
    """
    _command(team, None, ORDER, "resume")


@on_a_team
def abort(team: TeamAddress) -> None:
    """End the mission as failed. It cannot be taken back.

    Example: mrbt abort
    """
    _command(team, None, ORDER, "abort")


@on_a_team
def decide(
    team: TeamAddress,
    global_task: Annotated[str, typer.Argument(help="An exclusive task that is in doubt.")],
    decision: Annotated[Decision, typer.Argument(help="What became of it.")],
) -> None:
    """Say how an exclusive task goes on whose robot vanished in the middle of it.

    `done` and `failed` say how it ended; `retry` has it done again from the beginning.

    Example: mrbt decide "dose(2)" done
    """
    _command(team, None, DECIDE, f"{global_task} {decision}")


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
        """The robot's exit status if it ends instead of joining, None if it has joined."""
        process = await team.start(robot, robot_type=robot_type, takeover=takeover)
        async with watching(address_of(found)) as watcher:
            with anyio.fail_after(JOIN_TIMEOUT_S):
                while process.returncode is None:
                    await watcher.wait_for_change(watcher.timing.heartbeat_us / SECOND_US)
                    member = watcher.observer.facts.members.get(robot)
                    if member is not None and member[0].pid == process.pid:
                        return None
        return process.returncode

    try:
        with input_errors():
            code = anyio.run(start)
    except TimeoutError:
        fail(f"{robot} runs, and has not joined within {JOIN_TIMEOUT_S:g} s", FAILURE)
    if code is not None and code != 0:
        fail((found.path / f"{robot}.out").read_text().strip().rpartition("\n")[2], code)
    console.print(f"{robot} joined", highlight=False)
    end_process(0)


# -- status -------------------------------------------------------------------------------


@on_a_team
def status(team: TeamAddress, as_json: JsonOption = False) -> None:
    """Who does what, what is blocked, and whether all agree.

    Example: mrbt status --json
    """

    async def act(watcher: Watcher) -> int:
        if team.run_dir is None and not watcher.observer.robots():
            fail(_nobody(watcher), FAILURE)
        # Two beats tell who is silent, and what the others say of it.
        with anyio.move_on_after(SETTLE_BEATS * watcher.timing.heartbeat_us / SECOND_US):
            while True:
                await watcher.wait_for_change(0.05)
        watcher.refresh()
        data = status_data(watcher)
        if as_json:
            print_json(data)
        else:
            _print_status(data)
        return 0

    found = team.run_dir
    summary = found.summary() if found is not None else None
    if found is None or summary is None or any(found.process(r) for r in found.robots()):
        _with_team(team, act)
    if as_json:
        print_json(_final_status(summary))
    else:
        console.print(f"the run is over: {summary['result']}", highlight=False)


def _final_status(summary: dict[str, Any]) -> dict[str, Any]:
    """The status of a run that has ended, with the keys of a running one."""
    robots = {
        robot: {**row, "pid": None, "local_task": None} for robot, row in summary["robots"].items()
    }
    return {**summary, "over": True, "robots": robots, "blocked": [], "agreement": True}


def status_data(watcher: Watcher) -> dict[str, Any]:
    """The status as plain data."""
    observer, run_dir = watcher.observer, watcher.address.run_dir
    started = run_dir.robots() if run_dir is not None else []
    robots: dict[str, Any] = {}
    for robot in sorted({*observer.robots(), *started}):
        member = observer.facts.members.get(robot)
        claim = observer.claim(robot)
        state = observer.robot_state(robot)
        pid = member[0].pid if member is not None and state is not State.DEAD else None
        if run_dir is not None:
            process = run_dir.process(robot)
            pid = process.pid if process is not None else None
            if process is None and robot in started and state is State.ALIVE:
                # Its own record says it is gone, and nobody has heard it since.
                state = State.SUSPECT
        robots[robot] = {
            "host": member[0].host if member else None,
            "pid": pid,
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
        "run_dir": str(run_dir.path) if run_dir is not None else None,
    }


def _print_status(data: dict[str, Any]) -> None:
    headings = ("robot", "type", "host", "pid", "state", "works on", "lost")
    table = Table(*headings, box=None, header_style="dim")
    for robot, row in data["robots"].items():
        table.add_row(
            Text(robot, style="bold"),
            row["type"] or "",
            row["host"] or "",
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
