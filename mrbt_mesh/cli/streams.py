"""The standard streams of a command, which keep working if text cannot be encoded or written."""

from __future__ import annotations

import codecs
import io
import os
import sys
from typing import TextIO

ERRORS = "mrbt-legible"
# Signs of commands and of rich, with a replacement of one column each, to keep tables aligned.
PLAIN = {
    "✔✓": "+",
    "✘✖✗×": "x",
    "▶▸→↳›": ">",
    "●•◆": "*",
    "◌○◇": "o",
    "◐": "%",
    "◷↻": "@",
    "⇉∥‖": "=",
    "⧗": "~",
    "✂⊘": "/",
    "▲": "^",
    "▾": "v",
    "·…": ".",
    "─━═╴╸╺╶┄╌▱–—−": "-",
    "│┃║┊├┣┤┼╷╵╽╿": "|",
    "└┗╰": "`",
    "┌┐┘╭╮╯": "+",
    "■▣▤▰█▉▊▋▌▐": "#",
    "▍▎▏": ":",
    "≤": "<",
    "≥": ">",
    "µ": "u",
    "’‘": "'",
    "“”": '"',
    "\u2009\u202f\u00a0": " ",
}
_PLAIN = {sign: plain for signs, plain in PLAIN.items() for sign in signs}
_SURROGATES = range(0xDC80, 0xDD00)


class OutputError(OSError):
    """Standard output cannot be written, for example because its disk is full."""


def _legible(error: UnicodeError) -> tuple[str, int]:
    """Replace signs that a stream cannot encode with a plain sign, else with an escape.

    Bytes of a path that are not text are shown as `\\xe4`.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_PLAIN.get(sign) or _escaped(sign) for sign in text), error.end


def _escaped(sign: str) -> str:
    if ord(sign) in _SURROGATES:
        return f"\\x{ord(sign) - 0xDC00:02x}"
    return sign.encode("ascii", "backslashreplace").decode("ascii")


class _Output(io.TextIOWrapper):
    """A standard stream that encodes any text. With `loses`, output that cannot be written is
    dropped.
    """

    def __init__(self, buffer: io.BufferedIOBase, encoding: str, *, by_line: bool, loses: bool):
        super().__init__(buffer, encoding, ERRORS, line_buffering=by_line)  # type: ignore[arg-type]
        self.loses = loses

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The encoding. Latin-1 for ASCII, for which click would write UTF-8."""
        encoding = super().encoding
        return "latin-1" if codecs.lookup(encoding).name == "ascii" else encoding

    def write(self, text: str, /) -> int:
        try:
            return super().write(text)
        except OSError as error:
            self._failed(error)
        return len(text)

    def flush(self) -> None:
        try:
            super().flush()
        except OSError as error:
            self._failed(error)

    def _failed(self, error: OSError) -> None:
        if self.loses:
            return
        if isinstance(error, (BrokenPipeError, OutputError)):
            raise error
        raise OutputError(error.errno, error.strerror) from error


def prepare_streams() -> None:
    """Make stdout and stderr encode any text, and replace closed standard streams.

    Otherwise the next file that is opened would get the number of a closed stream, and printed text
    would go there.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number)
                os.close(opened)
            os.set_inheritable(number, True)
    if sys.stdin is None:
        _replace("stdin", open(os.devnull, encoding="utf-8"))  # noqa: SIM115
    _replace("stdout", _prepared(sys.stdout, loses=False))
    _replace("stderr", _prepared(sys.stderr, loses=True))


def lose_output_rather_than_end() -> None:
    """From now on drop output if a pipe is closed or a disk is full, without an error."""
    prepare_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, _Output):
            stream.loses = True


def _replace(name: str, stream: TextIO) -> None:
    """Replace a standard stream, including the original one in `sys.__stdout__` and so on."""
    for each in (name, f"__{name}__"):
        setattr(sys, each, stream)


def _prepared(stream: TextIO | None, *, loses: bool) -> TextIO:
    """Return the stream that replaces a standard one; None is a closed stream."""
    if stream is None:
        return _Output(io.BufferedWriter(_Nowhere()), "utf-8", by_line=False, loses=True)
    if not isinstance(stream, io.TextIOWrapper) or isinstance(stream, _Output):
        return stream
    encoding, by_line = stream.encoding, stream.line_buffering
    stream.flush()
    return _Output(stream.detach(), encoding, by_line=by_line, loses=loses)


class _Nowhere(io.RawIOBase):
    """Drops all output."""

    def writable(self) -> bool:
        return True

    def write(self, data: object, /) -> int:
        return memoryview(data).nbytes  # type: ignore[arg-type]


def drop_output() -> None:
    """Drop what stdout still holds but cannot write, or Python's last flush would fail."""
    try:
        number = sys.stdout.fileno()
    except (OSError, ValueError):
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)


codecs.register_error(ERRORS, _legible)
