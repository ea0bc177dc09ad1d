"""Errors for wrong input, which every command reports as a message, and for a failed task."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

MAX_SHOWN_CHARACTERS = 60
MAX_PATH_CHARACTERS = 160


class InputError(Exception):
    """Something that a person wrote is wrong. The message says where, and how to correct it.

    Commands print it and end with exit status 2. Each package derives its own errors from it.
    """


class MissingExtraError(InputError):
    """A part of the project needs libraries that are not installed; the message tells the
    remedy.
    """

    @classmethod
    def of(cls, what: str, extra: str) -> MissingExtraError:
        """Return the error for `what`, which needs the extra."""
        return cls(f"{what} needs the extra {extra!r}: pip install 'mrbt-mesh[{extra}]'")


class TaskFailedError(Exception):
    """Raise it in a local task, or in a leaf of a tree, to report failure with a reason.

    The log gets no traceback.
    """


@dataclass(frozen=True, slots=True)
class Problem:
    """One problem. `line` counts from 1; 0 means the file as a whole, e.g. if it is missing.

    `path` leads to the place inside the file, e.g. `tree/Sequence[2]/Parallel`.
    """

    file: str
    line: int
    path: str
    message: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        return f"{place}: {self.path}: {self.message}" if self.path else f"{place}: {self.message}"


class FileError(InputError):
    """A mission file that cannot be used; `str()` gives one line per problem."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: list[Problem] = list(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(str(problem) for problem in self.problems)


def whole_file_error(file: str, message: str) -> FileError:
    """Return a FileError about the file as a whole."""
    return FileError([Problem(file, 0, "", message)])


def require(what: str, extra: str, *modules: str) -> None:
    """Raise MissingExtraError unless the `modules` that the `extra` provides are installed."""
    if not all(map(is_installed, modules)):
        raise MissingExtraError.of(what, extra)


def is_installed(module: str) -> bool:
    """True if a module can be found; an installation may lack its package."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def nearest(name: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the most similar known name, else the known names."""
    names, name = sorted(known), name[:MAX_SHOWN_CHARACTERS]  # comparing long texts takes long
    close = difflib.get_close_matches(name, names, n=1)
    if not close and len(name) > 2:
        close = [each for each in names if each.lower().startswith(name.lower())][:1]
    if close:
        return f"; did you mean {close[0]!r}?"
    if not names:
        return "; there are none here"
    listed = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"; known: {listed}"


def read_limited(path: Path, limit_bytes: int) -> bytes:
    """Return the bytes of a file that a user named.

    Raises FileError if it cannot be read or is larger than `limit_bytes`.
    """
    file = str(path)
    try:
        if not path.exists():
            raise whole_file_error(file, "there is no such file")
        # Reading a pipe or a device could block or never end.
        if not path.is_file():
            raise whole_file_error(file, "not a file; give the file itself")
        with path.open("rb") as stream:
            content = stream.read(limit_bytes + 1)
    except OSError as error:
        raise whole_file_error(file, f"cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise whole_file_error(file, f"cannot be read: {error}") from None
    if len(content) > limit_bytes:
        raise whole_file_error(file, f"larger than the limit of {limit_bytes} bytes")
    return content


def lone(error: BaseException) -> BaseException:
    """Return the only exception of a group with one; a group of several is returned itself."""
    while isinstance(error, BaseExceptionGroup) and len(error.exceptions) == 1:
        error = error.exceptions[0]
    return error
