"""`mrbt watch`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.exporting import ExportOptions
from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import RecordBeatsOption
from mrbt_mesh.cli.team.metrics_options import MetricsOptions
from mrbt_mesh.cli.team.options import TeamOptions
from mrbt_mesh.cli.team.show_options import ShowOptions


def watch(
    show: ShowOptions,
    team: TeamOptions,
    metrics: MetricsOptions,
    export: ExportOptions,
    given: Given,
    record: Annotated[
        Path | None, option("Record what is heard; docs/recording.md.", "FILE.mcap")
    ] = None,
    record_beats: RecordBeatsOption = False,
) -> None:
    """Watch a team that runs already, or is yet to come; ending the view leaves it alone.

    Of a run that is over it prints the summary.

    Exit status: as of `mrbt up`.

    Example: mrbt up MISSION --detach; mrbt watch
    """
    from functools import partial

    import anyio

    from mrbt_mesh.cli.framework.exits import EXIT_OF_RESULT, end_process
    from mrbt_mesh.cli.team import watching
    from mrbt_mesh.cli.team.finished import summary_of_finished, tell_summary
    from mrbt_mesh.cli.team.sharing import sharing
    from mrbt_mesh.runtime.recording import RecordTo
    from mrbt_mesh.runtime.team import Team

    export.check()
    if record is None:
        given.refuse(["--record-beats"], "of a recording: give --record as well")
    found = team.run_directory(given)
    summary = summary_of_finished(found) if found is not None else None
    if summary is not None:
        tell_summary(summary, show.as_json)
        raise SystemExit(EXIT_OF_RESULT[summary["result"]])
    address = team.find(given)
    processes = Team(found, found.info(), address.mission) if found is not None else None
    to = RecordTo(record, "", record_beats) if record is not None else None
    if processes is None:
        watching.say_where(address, show)
    share = partial(sharing, metrics.address(given), export)
    watched = partial(watching.watch, address, processes, show, share=share, record=to)
    end_process(anyio.run(watched))
