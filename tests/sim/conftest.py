"""A fixture that the tests of the simulator share."""

from __future__ import annotations

import pytest

from tests.support.runs import Run, run_example


@pytest.fixture
def run() -> Run:
    """`run(name, seed, ...)`: simulate an example; no invariant may break on the way."""
    return run_example
