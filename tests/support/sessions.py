"""Scripts of Zenoh sessions, each in a process of its own: they would outlive that of the tests."""

from __future__ import annotations

import subprocess
import sys

from tests.support.paths import ROOT


def said_by(script: str, *arguments: str) -> str:
    """What the script writes; an AssertionError with what it says on stderr if it fails."""
    command = [sys.executable, "-c", script, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
