"""Zenoh sessions, each in a process of its own: they would outlive that of the tests."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.support.paths import ROOT


def said_by(script: str, *arguments: str) -> str:
    """The output of a script; an AssertionError with its stderr if it fails."""
    command = [sys.executable, "-c", script, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def intruder(**wanted: Any) -> Iterator[subprocess.Popen[str]]:
    """An intruder on the network; see `raw_intruder`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.support.raw_intruder", json.dumps(wanted)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
