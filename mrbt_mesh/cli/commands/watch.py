"""`mrbt watch`: watch a team that is running, or will run."""

from __future__ import annotations

from pathlib import Path

import click

from mrbt_mesh.cli.command import (
    EXIT_OF_RESULT,
    PATH,
    MrbtCommand,
    refuse,
)
from mrbt_mesh.cli.commands.agent import METRICS
from mrbt_mesh.cli.options import ShowOptions, record_beats_option, show_options
from mrbt_mesh.cli.plugged import ChosenViews, view_options
from mrbt_mesh.cli.team_options import TeamOptions, team_options


@click.command(cls=MrbtCommand)
@show_options
@team_options
@view_options
@click.option("--record", type=PATH, metavar="FILE.mcap", help="Record all that is heard.")
@record_beats_option
@METRICS[0]
@METRICS[1]
def watch(
    show: ShowOptions,
    team: TeamOptions,
    views: ChosenViews,
    record: Path | None,
    record_beats: bool,
    metrics_port: int | None,
    metrics_host: str,
) -> None:
    """Watch a team that runs already, or will run; it does not notice.

    On a machine that has had no run yet it waits for the first one.

    With --web and no team named, the page also lists all runs of this machine.

    Ends with the mission, or prints the summary of a run that is over. With a view, it goes on
    until the view is closed, or until Ctrl-C. Exit status: that of `mrbt up`; with a view 0.

    \b
    Example: mrbt up MISSION --detach
             mrbt watch
             mrbt watch --web --control
    """
    import anyio

    from mrbt_mesh.cli import watching
    from mrbt_mesh.cli.finished import print_summary, summary_of_finished
    from mrbt_mesh.plugins import MetricsAddress
    from mrbt_mesh.runtime.observer_recording import RecordTo
    from mrbt_mesh.runtime.team import Team

    views.check()
    if metrics_port is None:
        refuse("give --metrics-port too", "--metrics-host")
    metrics = MetricsAddress(metrics_port, metrics_host) if metrics_port is not None else None
    if record is None:
        refuse("of a recording: give --record as well", "--record-beats")
    if team.run_dir is None and team.mission is None:
        if not (metrics or record) and (name := watching.machine_view(views)):
            raise SystemExit(anyio.run(watching.show_machine, name, views, show))
        watching.wait_for_a_run()
    found = team.run_directory()
    if found is not None and not views.viewers:
        summary = summary_of_finished(found)
        if summary is not None:
            print_summary(summary, show.as_json)
            raise SystemExit(EXIT_OF_RESULT[summary["result"]])
    address = team.find()
    processes = Team(found, found.info(), address.mission) if found is not None else None
    if processes is None and not views.viewers:
        watching.print_where(address, show)
    session = watching.Session(
        address,
        processes,
        show,
        views,
        metrics=metrics,
        record=RecordTo(record, record_beats) if record is not None else None,
        past=watching.past_of(processes),
    )
    raise SystemExit(anyio.run(session.follow if views.viewers else session.run))
