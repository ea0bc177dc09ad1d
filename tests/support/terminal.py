"""A command in a terminal of its own: what it draws, and keys for it."""

from __future__ import annotations

import codecs
import fcntl
import os
import re
import select
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Mapping

from tests.support.paths import ROOT
from tests.support.team import WAIT_S

# Characters searched again when more has been drawn: no pattern is longer.
OVERLAP = 1_000
_CONTROLS = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|[\]P][^\x07\x1b]*(?:\x07|\x1b\\)|[@-_0-9=>])")
KEYS = {"tab": "\t", "escape": "\x1b", "down": "\x1b[B", "up": "\x1b[A", "enter": "\r"}


class Terminal:
    """`mrbt ...` on a pseudo-terminal; it is killed when the block ends.

    A wait in vain ends after `WAIT_S`, with what was drawn.
    """

    def __init__(
        self, *arguments: str, environment: Mapping[str, str], size: tuple[int, int] = (120, 40)
    ) -> None:
        """`size`: columns and lines. `text`: all that was drawn, without controls."""
        self.text = ""
        # The begin of a control whose end has not come yet.
        self._rest = ""
        # What was drawn before the last key is not waited for again.
        self._seen = 0
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")
        self._ours, theirs = os.openpty()
        columns, lines = size
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, "-m", "mrbt_mesh", *arguments],
            env={**environment, "TERM": "xterm-256color"},
            cwd=ROOT,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
        )
        os.close(theirs)

    def press(self, *keys: str) -> None:
        """Press keys: letters, or names of `KEYS`. Nothing may follow `escape` at once."""
        self._seen = len(self.text)
        os.write(self._ours, "".join(KEYS.get(key, key) for key in keys).encode())

    def wait_for(self, pattern: str) -> re.Match[str]:
        """Wait until this has been drawn since the last key."""
        until, wanted, begin = time.monotonic() + WAIT_S, re.compile(pattern), self._seen
        while (found := wanted.search(self.text, begin)) is None:
            begin = max(begin, len(self.text) - OVERLAP)
            assert self._read(until), f"{pattern!r} was never drawn:\n{self.text[self._seen :]}"
        return found

    def wait_for_end(self) -> int:
        """Wait until the command has ended by itself; its exit status."""
        until = time.monotonic() + WAIT_S
        while self._read(until):
            pass
        return self.process.wait(max(1.0, until - time.monotonic()))

    def _read(self, until: float) -> bool:
        """Take what is drawn next; False once nobody draws any more, or the time is over."""
        left_s = until - time.monotonic()
        if left_s <= 0 or not select.select([self._ours], [], [], left_s)[0]:
            return False
        try:
            found = os.read(self._ours, 1 << 16)
        except OSError:
            # So Linux says that the other side is closed.
            return False
        drawn = self._rest + self._decoder.decode(found)
        whole = _CONTROLS.sub("", drawn)
        end = whole.rfind("\x1b")
        end = len(whole) if end < 0 else end
        self.text, self._rest = self.text + whole[:end], whole[end:]
        return bool(found)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self._ours)
