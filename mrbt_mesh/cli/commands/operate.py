"""Acting on a running team: signals to processes of this machine, commands to robots."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Awaitable, Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from mrbt_mesh.cli.command import FAILURE, SUCCESS, MrbtCommand, fail
from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.cli.options import json_option, robot_argument, run_dir_option
from mrbt_mesh.cli.team_options import TeamOptions, team_options
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import WARNING

if TYPE_CHECKING:
    import psutil

    from mrbt_mesh.runtime.operator_call import Acknowledged
    from mrbt_mesh.runtime.team_address import TeamAddress
    from mrbt_mesh.runtime.team_client import TeamClient
    from mrbt_mesh.runtime.watcher import Watcher

CONNECT_TIMEOUT_S = 10.0
JOIN_TIMEOUT_S = 30.0
ATTEND_S = 1.0
# How long to wait for the departure of a robot whose answer was lost.
LEFT_S = 2.0
NOT_STOPPED = (
    "a silent robot stops when it hears one that has stopped; they stay 10 s for it, after that "
    "it may go on alone: `mrbt kill` it"
)


def report(as_json: bool, team: str, robots: Iterable[str], command: str, result: str) -> None:
    """Print the result of a command, and its team."""
    if as_json:
        data = {"team": team, "robots": [*robots], "command": command, "result": result}
        click.echo(json.dumps(data, indent=2))
    else:
        click.echo(f"{team}: {result}")


# -- signals ----------------------------------------------------------------------------------


def _signal(name: str, number: signal.Signals, done: str, text: str) -> click.Command:
    """Return a command that sends a signal to a robot's process on this machine."""

    @click.command(name, cls=MrbtCommand, help=f"{text}\n\nExample: mrbt {name} A1")
    @robot_argument
    @run_dir_option
    @json_option
    def send(robot: str, run_dir: Path | None, as_json: bool) -> None:
        import psutil

        from mrbt_mesh.runtime.command_log import check_signer
        from mrbt_mesh.runtime.known_runs import find_run

        found = find_run(run_dir)
        process = found.process(robot)
        if process is None:
            found.check_robot(robot)
            raise InputError(f"{robot} does not run in {found.path}; `mrbt join {robot}` starts it")
        check_signer(found)
        begun_s = time.time()
        try:
            process.send_signal(number)
        except psutil.Error as error:
            fail(f"cannot signal {robot} (pid {process.pid}): {error}", FAILURE)
        note_command(found, name, f"{robot} (pid {process.pid}) {done}", begun_s)
        report(as_json, found.info().team, [robot], name, f"{robot} (pid {process.pid}) {done}")

    return send


kill = _signal(
    "kill", signal.SIGKILL, "killed", "Kill a robot's process with SIGKILL: a major fault."
)
freeze = _signal(
    "freeze",
    signal.SIGSTOP,
    "frozen",
    "Freeze a robot's process with SIGSTOP: it falls silent, but its links stay up.",
)
thaw = _signal(
    "thaw", signal.SIGCONT, "continued", "Continue a frozen robot's process with SIGCONT."
)


# -- commands ----------------------------------------------------------------------------------


def _robot_command(name: str, text: str) -> click.Command:
    """Return a command that sends the operator command of its name to one robot."""

    @click.command(name, cls=MrbtCommand, help=f"{text}\n\nExample: mrbt {name} B1")
    @robot_argument
    @team_options
    @json_option
    def give(robot: str, team: TeamOptions, as_json: bool) -> None:
        _command(team, as_json, robot, name)

    return give


leave = _robot_command("leave", "Have a robot leave on purpose: its work is handed over at once.")


@click.command("return", cls=MrbtCommand)
@robot_argument
@team_options
@json_option
def return_(robot: str, team: TeamOptions, as_json: bool) -> None:
    """Give a borrowed robot back to the team.

    Example: mrbt return B1
    """

    async def give(client: TeamClient) -> str:
        await client.give_back(robot)
        return f"{robot} works for the team again"

    _operate(team, as_json, give, robot)


@click.command(cls=MrbtCommand)
@robot_argument
@click.option("--after", is_flag=True, help="After the task that it has, in place of at once.")
@team_options
@json_option
def borrow(robot: str, after: bool, team: TeamOptions, as_json: bool) -> None:
    """Take a robot out of the team's work, to drive it yourself until `mrbt return`.

    It stays a member and is seen; its work is handed over. This outlives a restart of the robot.

    Example: mrbt borrow A1
    """

    async def give(client: TeamClient) -> str:
        state = (await client.borrow(robot, after)).state
        return f"{robot} is borrowed by {state.get('by')}{' after its task' if after else ''}"

    _operate(team, as_json, give, robot)


@click.command(cls=MrbtCommand)
@team_options
def attend(team: TeamOptions) -> None:
    """Tell robots every second that an operator is here, until Ctrl-C.

    For missions whose robots stop without an operator (`on_lost_contact: {of: operator}`).

    Example: mrbt attend
    """
    import anyio

    from mrbt_mesh.features.contact.policy import ATTEND, policies

    async def act(watcher: Watcher) -> int:
        if not policies(watcher.observer.mission):
            raise InputError("robots of this mission wait for no operator (on_lost_contact)")

        problems: dict[str, str] = {}

        async def tell(robot: str) -> None:
            good, problem = False, "does not answer"
            with anyio.move_on_after(ATTEND_S):
                good, problem = await watcher.command(robot, ATTEND)
            problem = "" if good else problem
            if problem != problems.get(robot, ""):
                text = f"not heard: {problem}" if problem else "hears the operator again"
                click.echo(f"{WARNING} {robot} {text}", err=True)
            problems[robot] = problem

        click.echo("attending; Ctrl-C ends it")
        while True:
            async with anyio.create_task_group() as group:
                for robot in watcher.observer.membership.members():
                    group.start_soon(tell, robot)
                await anyio.sleep(ATTEND_S)

    with_team(team.find_running(), act)


@click.command(cls=MrbtCommand)
@robot_argument
@click.argument("capability", metavar="CAPABILITY", help="A local task, or `all` of them.")
@click.option(
    "--performance", metavar="X", help="Change how well the robot does it; 0 is a minor fault."
)
@click.option("--end", is_flag=True, help="End the fault: the robot has the capability again.")
@team_options
@json_option
def fault(
    robot: str,
    capability: str,
    performance: str | None,
    end: bool,
    team: TeamOptions,
    as_json: bool,
) -> None:
    """Make a robot lose a capability (a minor fault), or change its performance.

    A local task under way is cancelled if its capability is lost, and the plan gives it to another
    robot. Another performance counts from the next assignment on.

    \b
    Example: mrbt fault A1 replace_hw
             mrbt fault A1 replace_hw --end
             mrbt fault A1 replace_hw --performance 0.5
    """
    from mrbt_mesh.core.agent.operator_messages import FAULT, PERFORM, RESTORE

    if performance is None:
        _command(team, as_json, robot, RESTORE if end else FAULT, capability)
    if end:
        raise InputError("--end and --performance: give one of them")
    if capability == "all":
        raise InputError("--performance: of which capability? mrbt fault ROBOT CAPABILITY")
    _command(team, as_json, robot, PERFORM, f"{capability}={performance}")


def _team_command(name: str, text: str) -> click.Command:
    """Return a command that commands the whole team."""

    @click.command(
        name,
        cls=MrbtCommand,
        help=f"{text}\n\nIt goes to all robots at once. Status 1 if fewer than a majority have it, "
        "or it came too late."
        f"\n\nExample: mrbt {name}",
    )
    @team_options
    @json_option
    def give(team: TeamOptions, as_json: bool) -> None:
        async def order(client: TeamClient) -> str:
            done: Acknowledged = await getattr(client, name)()
            order = done.state.get("order")
            if order != name:
                fail(done.text(f"{name} came too late: {order} is the team's command"), FAILURE)
            text = done.text(f"{name} is the team's command")
            return f"{text}; {NOT_STOPPED}" if done.silent and order == "abort" else text

        _operate(team, as_json, order)

    return give


pause = _team_command("pause", "Stop all work of a team until `mrbt resume`.")
resume = _team_command("resume", "Resume the work of a paused team.")
abort = _team_command("abort", "End the mission as failed. It cannot be undone.")


def _running_text(robot: str, running: psutil.Process) -> str:
    import psutil

    text = f"robot {robot} is already running (pid {running.pid})"
    if running.status() == psutil.STATUS_STOPPED:
        return f"{text} and frozen: `mrbt thaw {robot}` lets it go on"
    return f"{text}: stop it first, or replace it with --takeover"


@click.command(cls=MrbtCommand)
@click.argument("global_task", metavar="GLOBAL_TASK", help="An exclusive task that is in doubt.")
@click.argument(
    "decision",
    metavar="DECISION",
    type=click.Choice(("done", "failed", "retry")),
    help="done or failed: how it ended; retry: it starts again.",
)
@click.option("--job", metavar="ID", help="The job that it is of, if several have it.")
@team_options
@json_option
def decide(
    global_task: str, decision: str, job: str | None, team: TeamOptions, as_json: bool
) -> None:
    """Decide about an exclusive task whose robot vanished while doing it.

    Example: mrbt decide "dose(2)" done
    """

    async def give(client: TeamClient) -> str:
        done = await client.decide(global_task, decision, job or "")
        what = f"{global_task} of job {job}" if job else global_task
        is_retry = decision == "retry"
        return done.text(f"{what} {'is tried again' if is_retry else f'counts as {decision}'}")

    _operate(team, as_json, give)


def _command(
    team: TeamOptions, as_json: bool, robot: str, command: str, argument: str = ""
) -> NoReturn:
    """Send a command to a robot, print its answer, and end the process."""

    _act(team, as_json, lambda watcher: robot_said(watcher, robot, command, argument), robot)


async def robot_said(watcher: Watcher, robot: str, command: str, argument: str) -> str:
    """Return a robot's answer to a command; ends the process if the robot refuses."""
    good, text = await watcher.command(robot, command, argument)
    if not good and command == leave.name and await _has_left(watcher, robot):
        return f"{robot} has left"
    if not good:
        fail(text, FAILURE)
    return text


async def _has_left(watcher: Watcher, robot: str) -> bool:
    """True if a robot without an answer has left: its session may have ended before the answer."""
    import anyio

    from mrbt_mesh.core.membership.peer import State

    with anyio.move_on_after(LEFT_S):
        while watcher.observer.robot_state(robot) is not State.LEFT:
            await watcher.wait_for_change(LEFT_S)
        return True
    return False


def _operate(
    team: TeamOptions,
    as_json: bool,
    give: Callable[[TeamClient], Awaitable[str]],
    robot: str | None = None,
) -> NoReturn:
    """Give a command, print its result, and end the process."""
    from mrbt_mesh.runtime.operator_call import CommandRefusedError
    from mrbt_mesh.runtime.team_client import TeamClient

    async def act(watcher: Watcher) -> str:
        try:
            return await give(TeamClient(watcher))
        except (CommandRefusedError, TimeoutError) as error:
            fail(str(error), FAILURE)

    _act(team, as_json, act, robot)


def _act(
    team: TeamOptions,
    as_json: bool,
    give: Callable[[Watcher], Awaitable[str]],
    robot: str | None,
) -> NoReturn:
    """Command a robot (None: the team), print and note the result, and end the process."""
    address = team.find_running()
    name = address.transport.team

    async def act(watcher: Watcher) -> int:
        living = list(watcher.observer.membership.members())
        if not living:
            fail(nobody(watcher), FAILURE)
        if robot is not None and robot not in watcher.observer.robots():
            fail(f"the team has no robot {robot} ({', '.join(watcher.observer.robots())})")
        text = await give(watcher)
        word = click.get_current_context().info_name or ""
        if address.run_dir is not None:
            note_command(address.run_dir, word, text)
        report(as_json, name, living if robot is None else [robot], word, text)
        return SUCCESS

    with_team(address, act)


def with_team(team: TeamAddress, act: Callable[[Watcher], Awaitable[int]]) -> NoReturn:
    """Attach to a team, act once a robot is heard, and end the process with the status of `act`.

    Raises TransportError if there is no way to attach.
    """
    import anyio

    from mrbt_mesh.runtime.watcher import watching

    async def attach() -> int:
        async with watching(team) as watcher:
            await watcher.catch_up(CONNECT_TIMEOUT_S)
            return await act(watcher)

    raise SystemExit(anyio.run(attach))


def nobody(watcher: Watcher) -> str:
    """Return a message for a team without an audible robot, with the known reasons."""
    team = watcher.address
    text = f"no robot of team {team.transport.team}, run {team.run}, answers"
    refused = watcher.observer.refused
    reasons = [f"{robot}: {refused[robot]}" for robot in sorted(refused)]
    if not reasons:
        reasons.append(f"nobody was heard on {team.transport.where()}")
        if team.run_dir is None and not team.transport.routers:
            reasons.append("MRBT_CONNECT=tcp/IP:PORT asks a robot where it listens")
    return "; ".join([text, *reasons])


# -- one more robot ---------------------------------------------------------------------------


@click.command(cls=MrbtCommand)
@robot_argument
@click.option(
    "--type", "robot_type", metavar="TYPE", help="Its type, if the mission does not list it."
)
@click.option("--takeover", is_flag=True, help="Replace a live robot of the same id.")
@run_dir_option
@json_option
def join(
    robot: str, robot_type: str | None, takeover: bool, run_dir: Path | None, as_json: bool
) -> None:
    """Start one more robot of the running mission, or restart a dead one.

    Example: mrbt join C1
    """
    import anyio

    from mrbt_mesh.cli.finished import reopen, start_summary_writer
    from mrbt_mesh.cli.terminal import warn
    from mrbt_mesh.core.membership.timing import SECOND_US
    from mrbt_mesh.core.mission.names import is_robot_id
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.command_log import check_signer
    from mrbt_mesh.runtime.journal import read_journals
    from mrbt_mesh.runtime.known_runs import find_run
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.team_address import address_of
    from mrbt_mesh.runtime.watcher import watching

    found = find_run(run_dir)
    mission = load_mission(found.mission_path)
    if not is_robot_id(robot):
        raise InputError(f"robot id {robot!r}: 1 to 32 letters, digits, '_' or '-'")
    types = ", ".join(sorted(mission.robot_types))
    if robot_type is not None and robot_type not in mission.robot_types:
        raise InputError(f"--type {robot_type}: the mission has no such robot type ({types})")
    if robot_type is None and robot not in mission.robots:
        raise InputError(f"the mission has no robot {robot}: give its --type ({types})")
    running = found.process(robot)
    if running is not None and not takeover:
        raise InputError(_running_text(robot, running))
    check_signer(found)
    had_ended = reopen(found)
    team = Team(found, found.info(), mission)
    if running is None:
        read_journals(found.path, [robot], mission.team_digest, team.info.run, warn)

    async def start() -> int | None:
        """Return the robot's exit status if it ends instead of joining, None if it has joined."""
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
        code = anyio.run(start)
    except TimeoutError:
        fail(f"{robot} runs, and has not joined within {JOIN_TIMEOUT_S:g} s", FAILURE)
    finally:
        if had_ended:
            start_summary_writer(found)
    if code is not None and code != SUCCESS:
        fail(team.last_word(robot, code), code)
    note_command(found, "join", f"{robot} joined")
    report(as_json, team.info.team, [robot], "join", f"{robot} joined")
    raise SystemExit(SUCCESS)
