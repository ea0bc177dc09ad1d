"""Bars on stderr for what takes long; they vanish at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from mrbt_mesh.cli.framework.terminal import errors


def bar_of_runs(*fields: str) -> Progress:
    """Many runs on their way.

    `fields` are texts of the bar's task besides how many are done, e.g. `{task.fields[rate]}`.
    """
    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        *map(TextColumn, fields),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
    )


@contextmanager
def bar_of_steps(first: str) -> Iterator[Callable[[str, int, int], None]]:
    """A function that is told (what is being done, how much is done, of how much)."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    is_hidden = not errors.is_terminal
    with Progress(*columns, console=errors, transient=True, disable=is_hidden) as bar:
        task = bar.add_task(first, total=None)

        def say(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        yield say
