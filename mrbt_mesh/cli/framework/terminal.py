"""Writing to the terminal, to programs and to files."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO, cast

from rich.console import Console
from rich.text import Text

from mrbt_mesh.errors import InputError

console = Console()
errors = Console(stderr=True, highlight=False)


class _LosableOutput:
    """A standard stream whose text is lost where it cannot be written."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError):
            self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def lose_output_rather_than_end() -> None:
    """From now on a closed pipe or a full disk costs what is printed, and ends nothing."""
    sys.stdout = cast(TextIO, _LosableOutput(sys.stdout))
    sys.stderr = cast(TextIO, _LosableOutput(sys.stderr))


def labelled(label: str, style: str, text: str) -> Text:
    """`label: text`, the label in a style; brackets in the text mean nothing."""
    return Text.assemble((f"{label}:", style), f" {text}")


def note(text: str) -> None:
    """Tell people, on stderr, something that is worth knowing."""
    errors.print(labelled("note", "yellow", text), soft_wrap=True)


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
    """Raise InputError if a folder that is to be made is there already, and not empty."""
    if path is not None and path.exists() and (not path.is_dir() or any(path.iterdir())):
        raise InputError(f"{option} {path}: is there already; name a new folder")
