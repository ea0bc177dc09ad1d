"""`mrbt drill`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import Given, argument, option
from mrbt_mesh.cli.options import JsonOption
from mrbt_mesh.errors import InputError


@dataclass(frozen=True)
class WhichOptions:
    """Which drills are run."""

    paths: Annotated[
        tuple[Path, ...], argument("DRILL.yaml", "Drill files, or folders of them.")
    ] = ()
    every: Annotated[
        bool, option("All drills of the folder `drills`, here or beside mrbt.", name="--all")
    ] = False
    quick: Annotated[bool, option("Only those that say `quick: true`.")] = False

    def check(self, listed: bool) -> None:
        """Raise InputError for a choice that is none, or two."""
        if self.paths and self.every:
            raise InputError("name drills, or say --all, not both")
        if not self.paths and not self.every and not listed and not self.quick:
            raise InputError("name a drill, or say --all; `mrbt drill --list` lists them")


def drill(
    which: WhichOptions,
    given: Given,
    listed: Annotated[bool, option("List the drills, run none.", name="--list")] = False,
    repeat: Annotated[int, option("So many times.", least=1)] = 1,
    brief: Annotated[bool, option("A line per run; the timeline only of those in red.")] = False,
    junit: Annotated[Path | None, option("Write JUnit XML.", "FILE")] = None,
    keep: Annotated[bool, option("Keep the run directories of green runs as well.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Run drills: real processes, faults at chosen moments, verdicts from what was done.

    Exit status: 0 all green (or skipped, with the reason), 1 an expectation did not hold, 2 bad
    input.

    Example: mrbt drill drills/freeze_then_thaw.yaml --repeat 3; mrbt drill --all --brief
    """
    import anyio

    from mrbt_mesh.cli.framework.exits import FAILURE, SUCCESS, end_process
    from mrbt_mesh.cli.framework.terminal import (
        check_folder,
        console,
        errors,
        print_json,
        write_file,
    )
    from mrbt_mesh.cli.team.drilling import DrillSession, chosen_drills
    from mrbt_mesh.cli.views.drill_view import render_list, render_total
    from mrbt_mesh.drills.report import junit_text, report_data

    if listed:
        given.refuse(("--repeat", "--brief", "--junit", "--keep", "--json"), "--list runs no drill")
    which.check(listed)
    check_folder("--junit", junit)
    drills = chosen_drills(which.paths, which.quick)
    if listed:
        console.print(render_list(drills))
        return
    runs, stopped = anyio.run(DrillSession(drills, repeat, brief, as_json, keep).run)
    if junit is not None:
        write_file(junit, junit_text(runs))
    if as_json:
        print_json(report_data(runs))
    else:
        console.print(render_total(runs))
        if stopped:
            errors.print("stopped by the operator before the end", style="red")
    end_process(FAILURE if stopped or not all(run.is_green for run in runs) else SUCCESS)
