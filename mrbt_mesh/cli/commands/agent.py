"""`mrbt agent`: one robot of a team, anywhere on the network."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from mrbt_mesh.cli.command import (
    PATH,
    FiniteNumber,
    MrbtCommand,
    options_as,
    refuse,
)
from mrbt_mesh.cli.network import NETWORK, warn_insecure
from mrbt_mesh.cli.options import (
    keep_option,
    program_option,
    record_beats_option,
    solver_option,
    speed_option,
)
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.settings import DEFAULT_ALONE_AFTER_S, DEFAULT_GATHER_S, MISSION_VARIABLE


def _names(context: click.Context, option: click.Parameter, value: str | None) -> Any:
    return None if value is None else tuple(value.split(","))


METRICS = (
    click.option(
        "--metrics-port",
        type=click.IntRange(1, 65_535),
        metavar="PORT",
        help="Serve metrics for Prometheus.",
    ),
    click.option(
        "--metrics-host",
        default="127.0.0.1",
        metavar="IP",
        help="Serve them on this address; 0.0.0.0: on all.",
    ),
)
robot_options = options_as(
    "options",
    RobotOptions,
    click.option("--type", metavar="TYPE", help="Its type, if the mission does not list it."),
    program_option,
    solver_option,
    speed_option,
    click.option("--run-dir", type=PATH, metavar="DIR", help="Folder for journal, log and events."),
    click.option("--record", type=PATH, metavar="FILE.mcap", help="Record its facts and actions."),
    record_beats_option,
    keep_option,
    click.option("--takeover", is_flag=True, help="Replace a live robot of the same id."),
    click.option("--exit-when-done", is_flag=True, help="Stop once the team has the result."),
    click.option(
        "--while-locked",
        type=PATH,
        metavar="FILE",
        help="Leave once no process holds a lock (flock) on it.",
    ),
    click.option(
        "--expect",
        metavar="A1,B1,...",
        callback=_names,
        help="Robots to hear before it starts. Default: all of the mission.",
    ),
    click.option(
        "--join-timeout",
        "gather_s",
        type=FiniteNumber(0, 86_400),
        default=DEFAULT_GATHER_S,
        metavar="SECONDS",
        help="How long it waits for them where there is no team yet.",
    ),
    click.option(
        "--alone-after",
        "alone_after_s",
        type=FiniteNumber(0, 86_400),
        default=DEFAULT_ALONE_AFTER_S,
        metavar="SECONDS",
        help="How long it waits if it hears no robot at all.",
    ),
    click.option("--alone", is_flag=True, help="Wait for no other robot: begin at once."),
    *NETWORK,
    click.option("--insecure", is_flag=True, help="Without --keys: believe every sender."),
    *METRICS,
)


@click.command(cls=MrbtCommand)
@click.option(
    "--mission",
    type=PATH,
    required=True,
    metavar="FILE",
    envvar=MISSION_VARIABLE,
    show_envvar=True,
    help="Mission file.",
)
@click.option("--robot", required=True, metavar="ID", help="This robot's id.")
@robot_options
def agent(mission: Path, robot: str, options: RobotOptions) -> None:
    """Run one robot, anywhere on the network.

    Exit status: 0 the mission succeeded or the robot left on purpose, 1 the mission failed, 2 bad
    input or refused, 70 the robot stopped because of a bug of mrbt.

    \b
    Example, two machines whose robots find each other by multicast:
      mrbt agent --mission examples/explore/mission.yaml --keys keys --robot R1
      mrbt agent --mission examples/explore/mission.yaml --keys keys --robot R2
    """
    from mrbt_mesh.runtime.robot_process import run_robot

    if options.insecure:
        refuse("with --insecure nothing is signed", "--keys")
        warn_insecure()
    elif options.keys is None:
        raise InputError(
            "without keys no robot knows the author of a message: give --keys DIR, made once with "
            f"`mrbt keys init DIR --robots {robot},...` and copied to every robot, "
            "or --insecure to believe everybody who reaches this robot's port"
        )
    if options.record is None:
        refuse("of a recording: give --record as well", "--record-beats")
    if options.metrics_port is None:
        refuse("give --metrics-port too", "--metrics-host")
    run_robot(mission, robot, options)
