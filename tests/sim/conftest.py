"""What the tests of the simulator share; the helpers are in the modules next to this one."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from runs import Run, run_example


@pytest.fixture
def run() -> Run:
    """`run(name, seed, ...)`: simulate an example; no invariant may break on the way."""
    return run_example
