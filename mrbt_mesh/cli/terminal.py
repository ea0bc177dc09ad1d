"""Output: to the terminal, to programs, to files; bars that show progress."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Container, Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, TypeVar, cast

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mrbt_mesh.errors import InputError

_T = TypeVar("_T")
console = Console()
errors = Console(stderr=True, highlight=False)


def labelled(label: str, style: str, text: str) -> Text:
    """`label: text`, the label in a style; brackets in the text mean nothing."""
    return Text.assemble((f"{label}:", style), f" {text}")


def table(*headings: str, right: Container[int] = ()) -> Table:
    """A table without lines; the columns whose numbers are in `right` hold figures.

    Without any headings it has no first row.
    """
    found = Table(
        box=None,
        header_style="dim",
        show_header=any(headings),
        padding=(0, 2, 0, 0),
        pad_edge=False,
    )
    for number, heading in enumerate(headings):
        justify: Literal["right", "left"] = "right" if number in right else "left"
        found.add_column(heading, justify=justify, no_wrap=number == 0, overflow="fold")
    return found


def note(text: str) -> None:
    """Print a note on stderr."""
    errors.print(labelled("note", "yellow", text), soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    errors.print(labelled("warning", "yellow", text), soft_wrap=True)


def print_done(word: str, text: str) -> None:
    """Print a success on stdout: a word in green, and its subject."""
    console.print(Text.assemble((word, "bold green"), f" {text}"), soft_wrap=True)


def json_text(data: Any) -> str:
    """One JSON document as text."""
    return json.dumps(data, indent=2) + "\n"


def print_json(data: Any) -> None:
    """One JSON document on stdout, as it is: no colours, no wrapping."""
    sys.stdout.write(json_text(data))


def write_file(path: Path, text: str) -> None:
    """Write a file that the user named; raises InputError if that cannot be done."""
    try:
        path.write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None


def reason(error: Exception) -> str:
    """Why a file could not be read or written, without its name."""
    return getattr(error, "strerror", None) or str(error)


def check_folder(option: str, path: Path | None) -> None:
    """Raise InputError, before long work begins, if the folder of a file to write is missing."""
    if path is not None and (path.is_dir() or not path.parent.is_dir()):
        what = "is a folder; name a file" if path.is_dir() else f"there is no folder {path.parent}"
        raise InputError(f"{option} {path}: {what}")


def check_outputs(mission: Path | None, outputs: Mapping[str, Path | None]) -> None:
    """Raise InputError if two files to write, by their options, are one, or the mission itself."""
    taken = {} if mission is None else {mission.resolve(): "the mission"}
    for option, path in outputs.items():
        if path is not None:
            other = taken.setdefault(path.resolve(), option)
            if other != option:
                raise InputError(f"{option} {path}: is {other} as well; name another file")
            check_folder(option, path)


def check_new_folder(option: str, path: Path | None) -> None:
    """Raise InputError if a folder to be made exists already and is not empty."""
    if path is not None and path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{option} {path}: exists already; name a new folder")


# -- progress ---------------------------------------------------------------------------------


def with_bar(
    title: str,
    runs: Iterator[_T],
    total: int | None,
    failed: Callable[[_T], bool] = lambda _: False,
) -> tuple[list[_T], bool]:
    """(all results, whether Ctrl-C ended it before), with a bar on stderr that vanishes."""
    from rich import progress

    found: list[_T] = []
    failures, started_s = 0, time.monotonic()
    columns = (
        progress.SpinnerColumn(),
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TextColumn("{task.fields[note]}"),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
    )
    bar = progress.Progress(*columns, console=errors, transient=True)
    with bar, contextlib.closing(cast("Generator[_T, None, None]", runs)):
        task = bar.add_task(title, total=total, note="")
        try:
            for each in runs:
                found.append(each)
                failures += failed(each)
                rate = 60 * len(found) / max(0.001, time.monotonic() - started_s)
                note = f"{rate:.0f} a minute" + (f", [red]{failures} failed[/]" if failures else "")
                bar.update(task, advance=1, note=note)
        except KeyboardInterrupt:
            return found, True
    return found, False


@contextmanager
def bar_of_steps(first: str) -> Iterator[Callable[[str, int, int | None], None]]:
    """A bar on stderr, if that is a terminal; yields its update: (text, steps done, of all)."""
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=errors, transient=True, disable=not errors.is_terminal
    ) as progress:
        task = progress.add_task(first, total=None)
        yield lambda what, done, of: progress.update(
            task, description=what, completed=done, total=of
        )
