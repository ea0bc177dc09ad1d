"""The teams of this machine: list them, end one, read the logs of its robots."""

from __future__ import annotations

import contextlib
import json
import time
from collections import deque
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import FAILURE, PATH, MrbtCommand, fail
from mrbt_mesh.cli.command_notes import note_command
from mrbt_mesh.cli.commands.operate import report
from mrbt_mesh.cli.options import json_option, robot_argument, run_dir_option
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir

# A launcher that has been asked to end gives its robots a few seconds to leave.
LAUNCHER_END_S = 20.0
LAUNCHER_LOOK_S = 0.05
LOOK_S = 0.2


@click.command(cls=MrbtCommand)
@json_option
def ls(as_json: bool) -> None:
    """List the teams of this machine, those that run first, then the newest.

    Commands take the name of a team, or of its mission if no other team has that.

    \b
    Example: mrbt ls
             mrbt status --run-dir vehicle_repair-3fa2b1
    """
    from mrbt_mesh.cli.run_list import listed_runs
    from mrbt_mesh.cli.terminal import console, print_json, table

    rows = listed_runs()
    if as_json:
        print_json({"runs": rows})
        return
    if not rows:
        click.echo("no run is known here: start one with `mrbt up`")
        return
    found = table("team", "since", "robots", "result")
    for row in rows:
        robots = f"{row['alive']}/{row['robots']}"
        found.add_row(row["team"], _since(row["started_unix_s"]), robots, row["result"])
    console.print(found)


def _since(unix_s: float | None) -> str:
    if unix_s is None:
        return ""
    started = datetime.fromtimestamp(unix_s)
    is_today = started.date() == datetime.now().date()
    return f"{started:%H:%M:%S}" if is_today else f"{started:%Y-%m-%d %H:%M}"


@click.command(cls=MrbtCommand)
@click.argument("team", metavar="[TEAM]", type=PATH, required=False, help="As --run-dir.")
@run_dir_option
@json_option
def down(team: Path | None, run_dir: Path | None, as_json: bool) -> None:
    """End a running team, as Ctrl-C in its `mrbt up` does: its robots leave.

    A robot that does not leave within a few seconds is killed. Exit status 1 if one still runs.

    Example: mrbt down vehicle_repair-3fa2b1
    """
    import anyio

    from mrbt_mesh.cli.finished import summary_of_finished
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.command_log import check_signer
    from mrbt_mesh.runtime.known_runs import find_run, is_running
    from mrbt_mesh.runtime.team import Team
    from mrbt_mesh.runtime.team_client import user_name

    if team is not None and run_dir is not None:
        raise InputError("TEAM and --run-dir are two ways to name a team: give one")
    found = find_run(team or run_dir, "mrbt down TEAM")
    info = found.info()
    if not is_running(found):
        raise InputError(f"team {info.team} does not run any more; `mrbt ls` lists those that do")
    check_signer(found)
    robots = [*found.living()]
    note_command(found, "down", f"ended by {user_name()} (mrbt down)")
    _end_launcher(found)
    anyio.run(Team(found, info, load_mission(found.mission_path)).end)
    if left := [f"{robot} (pid {process.pid})" for robot, process in found.living().items()]:
        fail(f"{info.team}: {', '.join(left)} cannot be ended", FAILURE)
    summary = summary_of_finished(found, is_witness=True)
    ended = "1 robot" if len(robots) == 1 else f"{len(robots)} robots"
    has_ended = summary is not None and summary["result"] in ("success", "failure")
    result = f", mission {summary['result']}" if summary and has_ended else ", mission not finished"
    report(as_json, info.team, robots, "down", f"{ended} ended{result}")


def _end_launcher(run_dir: RunDir) -> None:
    """Terminate the run's `mrbt up`, and kill it after `LAUNCHER_END_S`.

    Without a launcher nothing is done: the robots leave by themselves.
    """
    import psutil

    from mrbt_mesh.runtime.launcher_lock import launcher_of

    process = launcher_of(run_dir)
    if process is None:
        return
    with contextlib.suppress(psutil.NoSuchProcess):
        process.terminate()
        until_s = time.monotonic() + LAUNCHER_END_S
        # A process that has ended is a zombie until its parent asks for its status.
        while process.status() != psutil.STATUS_ZOMBIE:
            if time.monotonic() > until_s:
                process.kill()
                break
            time.sleep(LAUNCHER_LOOK_S)


@click.command(cls=MrbtCommand)
@robot_argument
@click.option("--follow", "-f", is_flag=True, help="Print new lines too, until the run is over.")
@click.option(
    "--lines", type=click.IntRange(0), default=100, metavar="N", help="The last N of each file."
)
@run_dir_option
def logs(robot: str, follow: bool, lines: int, run_dir: Path | None) -> None:
    """Print a robot's log, and after `|` what its program has printed.

    Example: mrbt logs A1 -f --lines 20
    """
    from mrbt_mesh.runtime.known_runs import find_run, is_running
    from mrbt_mesh.runtime.limited_file import NewLines

    found = find_run(run_dir)
    found.check_robot(robot)
    log, output = NewLines(found.log_path(robot)), NewLines(found.output_path(robot))
    printed = [f"| {line}" for line in deque(output.take(), lines)]
    printed += [_readable(line, robot) for line in deque(log.take(), lines)]
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            for line in printed:
                click.echo(line)
            if not follow:
                return
            follow = is_running(found)
            time.sleep(LOOK_S if follow else 0)
            printed = [f"| {line}" for line in output.take()]
            printed += [_readable(line, robot) for line in log.take()]


def _readable(line: str, robot: str) -> str:
    """Return a line of the robot's log as time of day, level, event and the remaining fields."""
    try:
        fields = json.loads(line)
        at = datetime.fromisoformat(fields.pop("timestamp")).astimezone()
        level, event = fields.pop("level"), fields.pop("event")
    except (ValueError, KeyError, TypeError, AttributeError):
        return line
    if fields.get("robot") == robot:
        del fields["robot"]
    words = [f"{at:%H:%M:%S.%f}"[:-3], *([] if level == "info" else [f"{level}:"]), event]
    return " ".join([*words, *(f"{name}={value}" for name, value in fields.items())])
