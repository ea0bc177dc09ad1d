"""Notes of operators' commands, in the run's files, for reports."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import WARNING

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir


def _print(text: str) -> None:
    click.echo(text, err=True)


def note_command(
    run_dir: RunDir,
    command: str,
    what: str,
    unix_s: float | None = None,
    warn: Callable[[str], None] = _print,
) -> None:
    """Note what `mrbt COMMAND` did at `unix_s`, by default now.

    A failure to note it is not an error, since the command was carried out: `warn` gets a warning,
    by default printed on stderr.
    """
    from mrbt_mesh.runtime import command_log

    try:
        command_log.note_command(run_dir, f"mrbt {command}", what, unix_s)
    except InputError as error:
        warn(f"{WARNING} {error}")
