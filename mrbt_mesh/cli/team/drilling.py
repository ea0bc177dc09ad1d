"""Drills one after the other, with what happens as it happens."""

from __future__ import annotations

import shutil
import signal
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import anyio
from rich.text import Text

from mrbt_mesh.cli.framework.terminal import console, errors
from mrbt_mesh.cli.views.drill_view import headline, line_text, takeover_text, verdict_text
from mrbt_mesh.drills.beside import BesideError
from mrbt_mesh.drills.drill_file import Drill, drill_files, drill_folder, load_drills
from mrbt_mesh.drills.judge import DrillVerdict
from mrbt_mesh.drills.model import Profile
from mrbt_mesh.drills.namespaces import NamespaceError
from mrbt_mesh.drills.network import why_not
from mrbt_mesh.drills.routers import RoutersError
from mrbt_mesh.drills.runner import DrillRun, TimelineEntry, run_drill
from mrbt_mesh.runtime.run_dir import RunDirError, state_dir
from mrbt_mesh.runtime.session_config import TransportError


def chosen_drills(paths: Sequence[Path], only_quick: bool) -> list[Drill]:
    """The drills of files and folders (none: of the usual folder).

    Raises InputError for whatever is wrong with them.
    """
    files: list[Path] = []
    for path in paths or [drill_folder()]:
        files += drill_files(path) if path.is_dir() else [path]
    drills = [drill for file in files for drill in load_drills(file)]
    return [drill for drill in drills if drill.model.quick] if only_quick else drills


class DrillSession:
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
        self._console = errors if quiet else console
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
            self._console.print(Text.assemble(title, "  ", headline(run)))
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
        except (
            TransportError,
            RunDirError,
            NamespaceError,
            RoutersError,
            BesideError,
        ) as error:
            return DrillRun(
                found.label,
                profile,
                verdicts=[DrillVerdict("the team could be run", False, str(error))],
            )

    def _print_line(self, line: TimelineEntry) -> None:
        self._console.print(line_text(line), soft_wrap=True)

    def _print_verdicts(self, run: DrillRun) -> None:
        for takeover in run.takeovers:
            self._console.print(takeover_text(takeover), soft_wrap=True)
        for verdict in run.verdicts:
            self._console.print(verdict_text(verdict), soft_wrap=True)
        self._console.print(Text.assemble("  ", headline(run)), soft_wrap=True)


def _run_folder(found: Drill) -> Path:
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S-%f")
    return state_dir() / "drills" / f"{found.model.name}-{stamp}"
