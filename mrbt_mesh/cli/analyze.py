"""`mrbt analyze`: which faults a mission survives, told beforehand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mrbt_mesh.cli.common import (
    JsonOption,
    MissionArgument,
    console,
    errors,
    fail,
    input_errors,
    print_json,
    read_mission,
)

DEFAULT_LIMIT_S = 5.0


def analyze(
    mission: MissionArgument,
    as_json: JsonOption = False,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Also write a report to look at.")
    ] = None,
    costs: Annotated[
        Path | None,
        typer.Option("--costs", metavar="FILE", help="Costs (.yaml) for the advice; see docs."),
    ] = None,
    limit_s: Annotated[
        float,
        typer.Option(
            "--limit", min=0.1, metavar="SECONDS", help="For each question put to the solver."
        ),
    ] = DEFAULT_LIMIT_S,
) -> None:
    """Tell which faults a mission survives, and what would make it survive more.

    Example: mrbt analyze examples/vehicle_repair/mission.yaml --html report.html
    """
    # For this command alone: the solver's library is large.
    from mrbt_mesh.analysis.analyse import analyse
    from mrbt_mesh.analysis.requirement import TooLargeError
    from mrbt_mesh.cli.analyze_html import html_report
    from mrbt_mesh.cli.analyze_view import render_analysis
    from mrbt_mesh.formats.costs_file import costs_from_file

    loaded = read_mission(mission)
    with input_errors():
        prices = loaded.costs if costs is None else costs_from_file(costs, loaded)
    try:
        with _progress() as say:
            found = analyse(loaded, prices, limit_s, say)
    except TooLargeError as error:
        fail(f"{mission}: {error}")
    if html is not None:
        try:
            html.write_text(html_report(found, prices), encoding="utf-8")
        except OSError as error:
            fail(f"cannot write {html}: {error.strerror}")
    if as_json:
        print_json(found.to_json())
        return
    console.print(render_analysis(found))
    if html is not None:
        console.print(f"\nwrote {html}", highlight=False, soft_wrap=True)


@contextmanager
def _progress() -> Iterator[Callable[[str, int, int], None]]:
    """A bar on stderr for what takes long; it vanishes at the end."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    is_hidden = not errors.is_terminal
    with Progress(*columns, console=errors, transient=True, disable=is_hidden) as bar:
        task = bar.add_task("reading the mission", total=None)

        def say(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        yield say
