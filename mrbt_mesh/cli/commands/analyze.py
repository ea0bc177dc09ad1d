"""`mrbt analyze`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption, MissionArgument


def analyze(
    mission: MissionArgument,
    html: Annotated[Path | None, option("Also write a report to look at.", "FILE")] = None,
    costs: Annotated[
        Path | None, option("Costs (.yaml) for the advice: docs/analyze.md.", "FILE")
    ] = None,
    limit: Annotated[
        float,
        option("For each question put to the solver.", "SECONDS", least=0.1),
    ] = 5.0,
    as_json: JsonOption = False,
) -> None:
    """Tell which faults a mission survives, and what would make it survive more.

    Example: mrbt analyze examples/vehicle_repair/mission.yaml --html report.html
    """
    import click

    from mrbt_mesh.analysis.tolerance.analyse import analyse
    from mrbt_mesh.analysis.tolerance.requirement import TooLargeError
    from mrbt_mesh.cli.framework.progress import bar_of_steps
    from mrbt_mesh.cli.framework.terminal import check_folder, console, print_json, write_file
    from mrbt_mesh.cli.views.analyze_html import html_report
    from mrbt_mesh.cli.views.analyze_view import render_analysis
    from mrbt_mesh.errors import InputError
    from mrbt_mesh.formats.costs_file import costs_from_file
    from mrbt_mesh.formats.mission_file import load_mission

    check_folder("--html", html)
    loaded = load_mission(mission)
    prices = loaded.costs if costs is None else costs_from_file(costs, loaded)
    try:
        with bar_of_steps("reading the mission") as say:
            found = analyse(loaded, prices, limit, say)
    except TooLargeError as error:
        raise InputError(f"{mission}: {error}") from None
    if html is not None:
        write_file(html, html_report(found, prices))
    if as_json:
        print_json(found.to_json())
        return
    console.print(render_analysis(found))
    if html is not None:
        click.echo(f"\nwrote {html}")
