"""Starts and ends an intruder, which runs in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.support.paths import ROOT


@contextmanager
def intruder(**wanted: Any) -> Iterator[subprocess.Popen[str]]:
    """Somebody on a network; see `raw_intruder`."""
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
