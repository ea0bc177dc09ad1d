"""`mrbt up` and `mrbt demo`: a team of processes on this machine."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh import plugins
from mrbt_mesh.cli.command import PATH, MrbtCommand, refuse
from mrbt_mesh.cli.network import (
    beat_option,
    detection_option,
    router_option,
    transport_option,
    warn_insecure,
)
from mrbt_mesh.cli.options import (
    ShowOptions,
    json_option,
    keep_option,
    mission_argument,
    program_option,
    record_beats_option,
    robots_option,
    show_options,
    solver_option,
    speed_option,
)
from mrbt_mesh.cli.plugged import ChosenViews, view_options
from mrbt_mesh.formats.shipped import examples
from mrbt_mesh.plugins import VIEWS, ViewerOptions
from mrbt_mesh.runtime.robot_options import RobotOptions

if TYPE_CHECKING:
    from mrbt_mesh.cli.guide import Guide


@click.command(cls=MrbtCommand)
@mission_argument
@robots_option
@program_option
@solver_option
@speed_option
@show_options
@view_options
@click.option("--detach", is_flag=True, help="Start the team and leave it running without `up`.")
@click.option(
    "--run-dir", type=PATH, metavar="DIR", help="Folder for logs, events and the summary."
)
@click.option(
    "--continue", "continues", is_flag=True, help="Continue the run in --run-dir from its journals."
)
@click.option("--no-record", is_flag=True, help="Write no recordings.")
@record_beats_option
@keep_option
@transport_option
@router_option
@beat_option
@detection_option
@click.option("--insecure", is_flag=True, help="Without keys: robots believe every sender.")
@click.option(
    "--metrics-port",
    type=click.IntRange(1, 65_535),
    metavar="PORT",
    help="Robots serve metrics for Prometheus, on this port and those that follow.",
)
def up(
    mission: Path,
    robots: str | None,
    program: str | None,
    show: ShowOptions,
    views: ChosenViews,
    detach: bool,
    run_dir: Path | None,
    continues: bool,
    no_record: bool,
    guide: Guide | None = None,
    **how: Any,
) -> None:
    """Start one process per robot and watch the mission.

    Exit status: 0 success, 1 failure, 2 bad input, 3 not finished in time, blocked, or ended before
    the team had gathered. A mission that never ends stops with --timeout, Ctrl-C or `mrbt abort`;
    its last complete round counts. If `up` ends in any way, its robots leave, unless it was
    --detach. After the end of the run --web serves the page until Ctrl-C.

    Example: mrbt up examples/vehicle_repair/mission.yaml --speed 2
    """
    from mrbt_mesh.cli.launching import continued, created, run_team
    from mrbt_mesh.cli.options import checked_program, chosen_robots
    from mrbt_mesh.formats.mission_file import load_mission
    from mrbt_mesh.runtime.solver_loader import solver_for
    from mrbt_mesh.runtime.team import new_run

    if detach:
        shown = ("--headless", "--json", "--timeout", *(f"--{name}" for name in VIEWS.names()))
        refuse("with --detach the run is not shown; see mrbt watch", *shown)
    if no_record:
        refuse("with --no-record nothing is recorded", "--record-beats")
    if how["metrics_port"] is not None:
        plugins.metrics().check()
    loaded = load_mission(mission)
    views.check(loaded)
    chosen = chosen_robots("--robots", robots, loaded)
    reference = checked_program(loaded, chosen, program)
    solver_for(loaded, how["solver"])
    info = new_run(
        loaded,
        mission,
        chosen,
        RobotOptions(program=reference, **how),
        record=not no_record,
    )
    if info.options.insecure:
        warn_insecure()
    found = (continued if continues else created)(run_dir, info, loaded)
    run_team(found, loaded, None if detach else show, views, guide)


@click.command(cls=MrbtCommand)
@click.argument(
    "example",
    metavar="[EXAMPLE]",
    default="vehicle_repair",
    help=f"One of {', '.join(examples())}. Default: vehicle_repair.",
)
@speed_option
@click.option("--headless", is_flag=True, help="Lines as things happen, no live view.")
@json_option
@click.pass_context
def demo(context: click.Context, example: str, speed: float, headless: bool, as_json: bool) -> None:
    """Run an example, by default six robots that repair a vehicle (about 30 s).

    It kills one robot at work by itself, and names a living one for you to kill next. Where the
    extra `web` is installed, a page shows the robots in the browser and has a button to kill each.
    Exit status: that of `mrbt up`.

    Example: mrbt demo; in a second terminal, while it runs: mrbt kill A1; mrbt status
    """
    from mrbt_mesh.cli.guide import Guide
    from mrbt_mesh.errors import InputError
    from mrbt_mesh.formats.shipped import example_mission

    mission = example_mission(example)
    page: dict[str, Any] = {}
    if not as_json and "web" in VIEWS.names():
        try:
            VIEWS.load("web").check(ViewerOptions(has_control=True))
            page = {"web": True, "control": True}
        except InputError as error:
            click.echo(str(error))
    if not as_json:
        click.echo(f"mrbt up {quote(str(mission))}")
    how = {"speed": speed, "headless": headless, "as_json": as_json}
    context.invoke(up, mission=mission, guide=Guide(speed), **how, **page)
