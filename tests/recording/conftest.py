"""A recorded run that several tests read."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.sim import SimulationResult
from tests.support.recorded import record_example


@pytest.fixture(scope="session")
def explored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulationResult]:
    """The folder of a short run without faults, and its result."""
    folder = tmp_path_factory.mktemp("explored")
    return folder, record_example(folder, "explore", 3)
