"""Output to the terminal, to programs and to files, and progress bars."""

from __future__ import annotations

import contextlib
import json
import shutil
import sys
import time
from collections.abc import Callable, Container, Generator, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

from mrbt_mesh.cli.printing import Console, Styled, Table
from mrbt_mesh.errors import InputError

_T = TypeVar("_T")
console = Console()
errors = Console(is_stderr=True)
# Progress bars: their columns, and the least time between two drawings.
_BAR_COLUMNS = 40
_DRAW_S = 0.1


def labelled(label: str, style: str, text: str) -> Styled:
    """Return `label: text` with the label in a style; brackets in the text have no meaning."""
    return Styled.assemble((f"{label}:", style), f" {text}")


def table(*headings: str, right: Container[int] = ()) -> Table:
    """Return a table without lines; the columns whose numbers are in `right` hold figures.

    Without headings it has no heading row.
    """
    return Table(headings, right)


def note(text: str) -> None:
    """Print a note on stderr."""
    errors.print(labelled("note", "yellow", text), soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    errors.print(labelled("warning", "yellow", text), soft_wrap=True)


def print_done(word: str, text: str) -> None:
    """Print a success on stdout: a word in green, and its subject."""
    console.print(Styled.assemble((word, "bold green"), f" {text}"), soft_wrap=True)


def json_text(data: Any) -> str:
    """Return a JSON document as text."""
    return json.dumps(data, indent=2) + "\n"


def print_json(data: Any) -> None:
    """Print a JSON document on stdout, without colours or wrapping."""
    sys.stdout.write(json_text(data))


def write_file(path: Path, text: str) -> None:
    """Write a file that the user named; raises InputError if that cannot be done."""
    try:
        path.write_text(text, encoding="utf-8")
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None


def reason(error: Exception) -> str:
    """Return why a file could not be read or written, without its name."""
    return getattr(error, "strerror", None) or str(error)


def check_folder(option: str, path: Path | None) -> None:
    """Raise InputError, before long work begins, if the folder of a file to write is missing."""
    if path is not None and (path.is_dir() or not path.parent.is_dir()):
        what = "is a folder; name a file" if path.is_dir() else f"there is no folder {path.parent}"
        raise InputError(f"{option} {path}: {what}")


def check_outputs(mission: Path | None, outputs: Mapping[str, Path | None]) -> None:
    """Raise InputError if two output files are the same file, or one is the mission.

    `outputs` maps options to files.
    """
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
    """Return (all results, whether Ctrl-C interrupted), with a temporary progress bar on stderr."""
    found: list[_T] = []
    failures, started_s = 0, time.monotonic()
    bar = _Bar(title, total)
    with bar.shown(), contextlib.closing(cast("Generator[_T, None, None]", runs)):
        try:
            for each in runs:
                found.append(each)
                failures += failed(each)
                rate = 60 * len(found) / max(0.001, time.monotonic() - started_s)
                left = f", {failures} failed" if failures else ""
                bar.draw(len(found), f"{rate:.0f} a minute{left}")
        except KeyboardInterrupt:
            return found, True
    return found, False


@contextmanager
def bar_of_steps(first: str) -> Iterator[Callable[[str, int, int | None], None]]:
    """Show a progress bar on stderr if that is a terminal.

    Yields a function that updates it: (text, steps done, of how many).
    """
    bar = _Bar(first, None)

    def update(what: str, done: int, of: int | None) -> None:
        bar.title, bar.total = what, of
        bar.draw(done, "")

    with bar.shown():
        yield update


class _Bar:
    """A progress bar on one line of stderr; nothing is shown if that is not a terminal."""

    def __init__(self, title: str, total: int | None) -> None:
        self.title, self.total = title, total
        self._begun_s = time.monotonic()
        self._drawn_s = 0.0

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the bar until the context ends."""
        self.draw(0, "")
        try:
            yield
        finally:
            self._write("")

    def draw(self, done: int, note: str) -> None:
        """Draw the bar, unless it was drawn just before."""
        now_s = time.monotonic()
        if now_s - self._drawn_s < _DRAW_S:
            return
        self._drawn_s = now_s
        parts = [self.title]
        if self.total:
            full = min(_BAR_COLUMNS, _BAR_COLUMNS * done // self.total)
            parts += ["━" * full + "─" * (_BAR_COLUMNS - full), f"{done}/{self.total}"]
        parts += [each for each in (note, f"{now_s - self._begun_s:.0f} s") if each]
        self._write(" ".join(parts))

    def _write(self, text: str) -> None:
        if errors.is_terminal:
            columns = shutil.get_terminal_size().columns
            errors.stream.write(f"\r\x1b[K{text[: columns - 1]}")
            errors.stream.flush()
