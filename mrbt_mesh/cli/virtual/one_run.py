"""The end of one simulated run: its files, its summary, its exit status."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from mrbt_mesh.cli.command import EXIT_OF_RESULT, FAILURE, fail
from mrbt_mesh.cli.printing import Styled
from mrbt_mesh.cli.terminal import (
    console,
    errors,
    json_text,
    labelled,
    note,
    print_json,
    reason,
)
from mrbt_mesh.cli.views.summary_view import render_summary
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.run_dir import SUMMARY_FILE
from mrbt_mesh.sim.run import SimulationError, SimulationResult
from mrbt_mesh.sim.world.named_faults import NamedFault, missed


@dataclass(frozen=True)
class RunFiles:
    """The files to write for a simulated run."""

    events: Path | None
    log: Path | None
    record: Path | None


def run_and_print(
    run: Callable[..., SimulationResult],
    named: Sequence[NamedFault],
    files: RunFiles,
    as_json: bool,
) -> NoReturn:
    """Run a simulation, write its files, print its summary, and exit with its status.

    `run` takes `keep_log` and `record`. Raises InputError for files that cannot be written.
    """
    try:
        result = run(keep_log=files.log is not None, record=files.record)
    except OSError as error:
        raise InputError(f"--record {files.record}: cannot be written: {reason(error)}") from None
    except SimulationError as error:
        fail(str(error), FAILURE)
    _write_files(result, files)
    if as_json:
        extra = {"effect_log_digest": result.effect_log_digest, "seed": result.seed}
        print_json({**result.summary, **extra, "violations": result.violations})
    else:
        console.print(render_summary(result.summary))
        seed = f" seed {result.seed}, effect log {result.effect_log_digest}"
        console.print(Styled(seed, "dim"))
    for text in missed(named, result.duration_us):
        note(text)
    for violation in result.violations:
        text = f"seed {result.seed}: {violation}"
        errors.print(labelled("invariant violated", "bold red", text))
    raise SystemExit(FAILURE if result.violations else EXIT_OF_RESULT[result.result])


def _write_files(result: SimulationResult, files: RunFiles) -> None:
    try:
        if files.events is not None:
            result.write_events(files.events)
        if files.log is not None:
            lines = "".join(f"{line}\n" for line in result.effect_log)
            files.log.write_text(lines, encoding="utf-8")
        if files.record is not None:
            # Beside its recordings, as in a run directory of `mrbt up`.
            (files.record / SUMMARY_FILE).write_text(json_text(result.summary), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{error.filename}: cannot be written: {reason(error)}") from None
