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
            "Recordings, run directories, and what sim, up, drill or chaos print with --json. "
            "Default: the last run's directory.",
        ),
    ] = (),
    output: Annotated[Path, option("Write the page to this file.", "FILE.html", short="-o")] = Path(
        "report.html"
    ),
    as_json: JsonOption = False,
) -> None:
    """Report on runs: results, who worked and waited when, faults and takeovers.

    It writes one HTML page that needs nothing else, and that any browser prints; several runs are
    compared. With --json it prints the figures instead.

    Example: mrbt report RUN_DIR -o report.html
    """
    import click

    from mrbt_mesh.cli.framework.terminal import check_outputs, print_json, write_file
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.views.report.page import report_html
    from mrbt_mesh.views.report.sources import read_report

    if not as_json:
        check_outputs(None, {"-o": output})
    found = read_report(paths or (RunDir.find(None).path,))
    if as_json:
        print_json(found.to_json())
    else:
        write_file(output, report_html(found))
        click.echo(f"wrote {output}")
