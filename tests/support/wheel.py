"""The project's wheel."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

WAIT_S = 300


def build_wheel(folder: Path) -> Path:
    """Build it into an empty folder; returns the file."""
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel"]
    subprocess.run(
        [*build, "--directory", str(folder)],
        cwd=ROOT,
        check=True,
        timeout=WAIT_S,
        stdout=subprocess.DEVNULL,
    )
    (path,) = folder.glob("*.whl")
    return path
