"""`mrbt drill`: missions on real processes with faults, and what must hold all the same."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Annotated

import anyio
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from mrbt_mesh.cli.common import (
    FAILURE,
    SUCCESS,
    InputError,
    JsonOption,
    console,
    end_process,
    errors,
    input_errors,
    print_json,
)
from mrbt_mesh.drills.drill_file import Drill, drill_files, drill_folder, load_drills
from mrbt_mesh.drills.judge import DrillVerdict
from mrbt_mesh.drills.model import Profile
from mrbt_mesh.drills.namespaces import NamespaceError
from mrbt_mesh.drills.network import why_not
from mrbt_mesh.drills.report import junit_text, report_data
from mrbt_mesh.drills.runner import DrillRun, TimelineEntry, run_drill
from mrbt_mesh.runtime.run_dir import RunDirError, state_dir
from mrbt_mesh.runtime.zenoh_transport import TransportError

PathsArgument = Annotated[
    list[Path] | None,
    typer.Argument(help="Drill files, or folders of them.", metavar="DRILL.yaml"),
]


def drill(
    paths: PathsArgument = None,
    every: Annotated[
        bool, typer.Option("--all", help="All drills of the folder `drills`, here or beside mrbt.")
    ] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only those that say `quick: true`.")
    ] = False,
    listed: Annotated[bool, typer.Option("--list", help="List the drills, run none.")] = False,
    repeat: Annotated[int, typer.Option("--repeat", min=1, help="So many times.")] = 1,
    brief: Annotated[
        bool, typer.Option("--brief", help="A line per run; the timeline only of those in red.")
    ] = False,
    as_json: JsonOption = False,
    junit: Annotated[
        Path | None, typer.Option("--junit", metavar="FILE", help="Write JUnit XML.")
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the run directories of green runs as well.")
    ] = False,
) -> None:
    """Run drills: a team of real processes, faults at chosen moments, verdicts from what was done.

    Exit status: 0 all green (or skipped, with the reason), 1 an expectation did not hold, 2 bad
    input.

    Example: mrbt drill drills/freeze_then_thaw.yaml --repeat 3; mrbt drill --all --brief
    """
    with input_errors():
        drills = _chosen(paths or [], every, quick, listed)
        if junit is not None and not junit.parent.is_dir():
            raise InputError(f"--junit {junit}: there is no folder {junit.parent}")
    if listed:
        _print_list(drills)
        return
    runs, stopped = anyio.run(_Session(drills, repeat, brief, as_json, keep).run)
    if junit is not None:
        junit.write_text(junit_text(runs))
    if as_json:
        print_json(report_data(runs))
    else:
        _print_total(runs, stopped)
    end_process(FAILURE if stopped or not all(run.is_green for run in runs) else SUCCESS)


def _chosen(paths: list[Path], every: bool, quick: bool, listed: bool) -> list[Drill]:
    if paths and every:
        raise InputError("name drills, or say --all, not both")
    if not paths and not every and not listed and not quick:
        raise InputError("name a drill, or say --all; `mrbt drill --list` lists them")
    files: list[Path] = []
    for path in paths or [drill_folder()]:
        files += drill_files(path) if path.is_dir() else [path]
    drills = [drill for file in files for drill in load_drills(file)]
    return [drill for drill in drills if drill.model.quick] if quick else drills


def _print_list(drills: list[Drill]) -> None:
    """One row per drill file."""
    table = Table(box=None, header_style="dim")
    for heading in ("drill", "runs", "needs", "", "what happens"):
        table.add_column(heading, no_wrap=heading != "what happens")
    by_file: dict[Path, list[Drill]] = {}
    for found in drills:
        by_file.setdefault(found.path, []).append(found)
    for group in by_file.values():
        model = group[0].model
        table.add_row(
            Text(model.name, "bold"),
            str(len(group) * len(model.profiles)),
            model.network if model.network != "loopback" else "",
            "quick" if model.quick else "",
            Text(" ".join(model.description.split()).partition(". ")[0].rstrip(".")),
        )
    console.print(table)


class _Session:
    """Runs drills one after the other, until all are done or the operator stops it."""

    def __init__(
        self, drills: list[Drill], repeat: int, brief: bool, quiet: bool, keep: bool
    ) -> None:
        self._plan = [
            (drill, profile)
            for _ in range(repeat)
            for drill in drills
            for profile in drill.model.profiles
        ]
        self._brief = brief
        # Results for programs go to stdout alone; people may still see how far it is.
        self._console = Console(stderr=True, highlight=False) if quiet else console
        self._keep = keep
        self._stopped = False

    async def run(self) -> tuple[list[DrillRun], bool]:
        """(the runs, whether the operator stopped it before the end)."""
        runs: list[DrillRun] = []
        async with anyio.create_task_group() as group:
            group.start_soon(self._wait_for_signal, group.cancel_scope)
            for number, (found, profile) in enumerate(self._plan, start=1):
                runs.append(await self._one(found, profile, number))
            group.cancel_scope.cancel()
        return runs, self._stopped

    async def _wait_for_signal(self, scope: anyio.CancelScope) -> None:
        with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
            async for _ in signals:
                self._stopped = True
                scope.cancel()

    async def _one(self, found: Drill, profile: Profile, number: int) -> DrillRun:
        title = Text.assemble(
            (f"{number}/{len(self._plan)} ", "dim"), (found.label, "bold"), (f"  {profile}", "dim")
        )
        if not self._brief:
            self._console.print(title)
        folder = _run_folder(found)
        run = await self._run_or_skip(found, profile, folder)
        if self._brief:
            self._console.print(Text.assemble(title, "  ", _headline(run)))
            if not run.is_green:
                for line in run.timeline:
                    self._print_line(line)
        if not self._brief or not run.is_green:
            self._print_verdicts(run)
        if run.is_green and not self._keep:
            shutil.rmtree(folder, ignore_errors=True)
            run.run_dir = None
        elif run.run_dir is not None:
            self._console.print(f"  kept: {run.run_dir}", style="dim", soft_wrap=True)
        return run

    async def _run_or_skip(self, found: Drill, profile: Profile, folder: Path) -> DrillRun:
        reason = why_not(found)
        if reason is not None:
            return DrillRun(found.label, profile, skipped=reason)
        tell = (lambda line: None) if self._brief else self._print_line
        try:
            return await run_drill(found, profile, folder, tell)
        except (TransportError, RunDirError, NamespaceError) as error:
            return DrillRun(
                found.label,
                profile,
                verdicts=[DrillVerdict("the team could be run", False, str(error))],
            )

    def _print_line(self, line: TimelineEntry) -> None:
        style = "red" if line.is_fault or line.text == "is dead" else ""
        self._console.print(
            Text.assemble(
                (f"{line.at_s:9.3f}  ", "dim"), (f"{line.robot:5} ", "bold"), (line.text, style)
            ),
            soft_wrap=True,
        )

    def _print_verdicts(self, run: DrillRun) -> None:
        for takeover in run.takeovers:
            self._console.print(_takeover_text(takeover), soft_wrap=True)
        for verdict in run.verdicts:
            self._console.print(_verdict_text(verdict), soft_wrap=True)
        self._console.print(Text.assemble("  ", _headline(run)), soft_wrap=True)


def _run_folder(found: Drill) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
    return state_dir() / "drills" / f"{found.model.name}-{stamp}"


def _takeover_text(takeover: dict[str, object]) -> Text:
    line = Text.assemble("  ", ("↻ ", "yellow"), (str(takeover["robot"]), "bold"))
    if not takeover["inflicted"]:
        return line.append(f" held dead by others at {takeover['at_s']:.3f} s", "not bold")
    line.append(f" lost at {takeover['at_s']:.3f} s", "not bold")
    line.append(f", detected after {_milliseconds(takeover['detected_s'])}", "not bold")
    if takeover["held"]:
        line.append(f", while on {takeover['held']}", "not bold")
    if takeover["replacement"]:
        after = _milliseconds(takeover["reassigned_s"])
        line.append(f", taken over by {takeover['replacement']} after {after}", "not bold")
    return line


def _verdict_text(verdict: DrillVerdict) -> Text:
    sign, style = ("✔", "green") if verdict.holds else ("✘", "bold red")
    return Text.assemble(
        "  ", (f"{sign} ", style), (verdict.expected, "" if verdict.holds else "red"),
        (f": {verdict.found}", "dim" if verdict.holds else "red"),
    )  # fmt: skip


def _headline(run: DrillRun) -> Text:
    if run.skipped is not None:
        return Text(f"skipped: {run.skipped}", "yellow")
    text = Text("green", "bold green") if run.is_green else Text("red", "bold red")
    text.append(f" in {run.duration_s:.1f} s", "not bold dim")
    wrong = [verdict for verdict in run.verdicts if not verdict.holds]
    for verdict in wrong:
        text.append(f"; {verdict.expected}: {verdict.found}", "not bold red")
    return text


def _print_total(runs: Iterable[DrillRun], stopped: bool) -> None:
    data = report_data(runs)
    seconds = sum(run.duration_s for run in runs)
    line = Text.assemble(
        (f"{data['green']} green", "bold green"),
        (f", {data['red']} red", "bold red" if data["red"] else "dim"),
        (f", {data['skipped']} skipped", "yellow" if data["skipped"] else "dim"),
        (f" in {seconds:.0f} s", "dim"),
    )
    console.print(line)
    if stopped:
        errors.print("stopped by the operator before the end", style="red")


def _milliseconds(value: object) -> str:
    return "?" if not isinstance(value, int | float) else f"{value * 1_000:.0f} ms"
