"""`mrbt report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import argument, option
from mrbt_mesh.cli.options import JsonOption


def report(
    paths: Annotated[
        tuple[Path, ...],
        argument(
            "FILE|RUN_DIR",
            "Recordings, run directories, and what sim, up, drill or chaos told with --json. "
            "Default: the last run's directory.",
        ),
    ] = (),
    output: Annotated[
        Path | None,
        option("Write it there: .html, .md, .pdf or .png.", "FILE", short="-o"),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Report on runs: what came of them, who worked and waited when, faults and takeovers.

    One page that needs nothing else; several runs are compared. Without -o and --json it prints
    Markdown. PDF and PNG are made by Chromium, where it is installed.

    Example: mrbt report RUN_DIR -o report.html; mrbt report run.mcap drills.json -o report.md
    """
    from mrbt_mesh.cli.framework.terminal import print_json
    from mrbt_mesh.cli.recordings.reporting import check_output, read_report, write_report
    from mrbt_mesh.cli.views.report_markdown import report_markdown
    from mrbt_mesh.runtime.run_dir import RunDir

    if output is not None:
        check_output(output)
    found = read_report(paths or (RunDir.find(None).path,))
    if output is not None:
        write_report(found, output)
    if as_json:
        print_json(found.to_json())
    elif output is None:
        import click

        click.echo(report_markdown(found), nl=False)
