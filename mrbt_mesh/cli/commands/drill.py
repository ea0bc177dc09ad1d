"""`mrbt drill`: real processes, faults at chosen moments, and a judge."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import FAILURE, PATH, SUCCESS, MrbtCommand, refuse
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.errors import InputError

if TYPE_CHECKING:
    from mrbt_mesh.cli.printing import Console
    from mrbt_mesh.drills.drill_file import Drill
    from mrbt_mesh.drills.model import Profile
    from mrbt_mesh.drills.runner import DrillRun


@click.command(cls=MrbtCommand)
@click.argument(
    "paths", metavar="[DRILL.yaml]...", type=PATH, nargs=-1, help="Drills, or their folders."
)
@click.option("--all", "every", is_flag=True, help="All drills of the folder `drills`.")
@click.option("--quick", is_flag=True, help="Only those that have `quick: true`.")
@click.option("--list", "listed", is_flag=True, help="List the drills, run none.")
@click.option(
    "--repeat", type=click.IntRange(1), metavar="N", default=1, help="Number of runs of each."
)
@click.option("--brief", is_flag=True, help="A line for each run; of red ones all that happened.")
@click.option("--junit", type=PATH, metavar="FILE", help="Write JUnit XML.")
@click.option("--keep", is_flag=True, help="Keep the run directories of green runs as well.")
@json_option
def drill(
    paths: tuple[Path, ...],
    every: bool,
    quick: bool,
    listed: bool,
    repeat: int,
    brief: bool,
    junit: Path | None,
    keep: bool,
    as_json: bool,
) -> None:
    """Run drills: real processes, faults at chosen moments, judged by the robots' actions.

    Exit status: 0 all green (or skipped, with the reason), 1 an expectation did not hold, 2 bad
    input.

    \b
    Example: mrbt drill drills/freeze_then_thaw.yaml --repeat 3
             mrbt drill --all --brief
    """
    import anyio

    from mrbt_mesh.cli.printing import Styled
    from mrbt_mesh.cli.terminal import check_folder, console, errors, print_json, write_file
    from mrbt_mesh.cli.views.drill_view import render_list, render_total
    from mrbt_mesh.drills.report import junit_text, report_data

    if listed:
        refuse("--list runs no drill", "--repeat", "--brief", "--junit", "--keep", "--json")
    if paths and every:
        raise InputError("name drills, or give --all, not both")
    if not paths and not every and not listed and not quick:
        raise InputError("name a drill, or give --all; `mrbt drill --list` lists them")
    check_folder("--junit", junit)
    drills = _chosen(paths, quick)
    if listed:
        console.print(render_list(drills))
        return
    # With --json, stdout is for the result only; progress is printed on stderr.
    session = _Session(drills, repeat, brief, keep, errors if as_json else console)
    runs, stopped = anyio.run(session.run)
    if junit is not None:
        write_file(junit, junit_text(runs))
    if as_json:
        print_json(report_data(runs))
    else:
        console.print(render_total(runs))
        if stopped:
            errors.print(Styled("stopped by the operator before the end", "red"))
    raise SystemExit(FAILURE if stopped or not all(run.is_green for run in runs) else SUCCESS)


def _chosen(paths: tuple[Path, ...], only_quick: bool) -> list[Drill]:
    """Return the drills of files and folders, by default of the drill folder. Raises InputError."""
    from mrbt_mesh.drills.drill_file import drill_files, drill_folder, load_drills

    files: list[Path] = []
    for path in paths or (drill_folder(),):
        files += drill_files(path) if path.is_dir() else [path]
    drills = [each for file in files for each in load_drills(file)]
    return [each for each in drills if each.model.quick] if only_quick else drills


class _Session:
    """Runs drills one after the other, until all are done or the operator stops them."""

    def __init__(
        self, drills: list[Drill], repeat: int, brief: bool, keep: bool, output: Console
    ) -> None:
        all_runs = [(each, profile) for each in drills for profile in each.model.profiles]
        self._plan = all_runs * repeat
        self._brief, self._keep, self._output = brief, keep, output

    async def run(self) -> tuple[list[DrillRun], bool]:
        """Return (the runs, whether the operator stopped them early)."""
        import signal

        import anyio

        runs: list[DrillRun] = []
        stopped = False
        async with anyio.create_task_group() as group:

            async def wait_for_signal() -> None:
                nonlocal stopped
                with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
                    async for _ in signals:
                        stopped = True
                        group.cancel_scope.cancel()

            group.start_soon(wait_for_signal)
            for number, (found, profile) in enumerate(self._plan, start=1):
                runs.append(await self._one(found, profile, number))
            group.cancel_scope.cancel()
        return runs, stopped

    async def _one(self, found: Drill, profile: Profile, number: int) -> DrillRun:
        import shutil
        from datetime import datetime

        from mrbt_mesh.cli.printing import Styled
        from mrbt_mesh.cli.views.drill_view import headline, line_text, result_text, takeover_text
        from mrbt_mesh.drills.judge import DrillResult
        from mrbt_mesh.drills.namespaces import NamespaceError
        from mrbt_mesh.drills.network import why_not
        from mrbt_mesh.drills.runner import DrillRun, run_drill
        from mrbt_mesh.runtime.run_dir import state_dir

        def show(*lines: str | Styled) -> None:
            for line in lines:
                self._output.print(line, soft_wrap=True)

        title = Styled.assemble(
            (f"{number}/{len(self._plan)} ", "dim"), (found.label, "bold"), (f"  {profile}", "dim")
        )
        if not self._brief:
            show(title)
        stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
        folder = state_dir() / "drills" / f"{found.model.name}-{stamp}"
        reason = why_not(found)
        if reason is not None:
            run = DrillRun(found.label, profile, skipped=reason)
        else:
            on_line = (lambda _: None) if self._brief else (lambda line: show(line_text(line)))
            try:
                run = await run_drill(found, profile, folder, on_line)
            except (InputError, NamespaceError) as error:
                failed = DrillResult("the team could be run", False, str(error))
                run = DrillRun(found.label, profile, results=[failed])
        if self._brief:
            show(Styled.assemble(title, "  ", headline(run)))
            show(*map(line_text, () if run.is_green else run.timeline))
        if not self._brief or not run.is_green:
            show(*map(takeover_text, run.takeovers), *map(result_text, run.results))
            show(Styled.assemble("  ", headline(run)))
        if run.is_green and not self._keep:
            shutil.rmtree(folder, ignore_errors=True)
            run.run_dir = None
        elif run.run_dir is not None:
            self._output.print(Styled(f"  kept: {run.run_dir}", "dim"), soft_wrap=True)
        return run
