"""Settings of the property tests: a failure prints what replays it, and no clock decides."""

from __future__ import annotations

import gc
import os

from hypothesis import HealthCheck, settings

# As where the package is installed: pytest finds it by its entry point.
from mrbt_mesh.pytest_plugin import run_mission as run_mission

settings.register_profile(
    "project",
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
    # `make test-long` tries more.
    max_examples=int(os.environ.get("MRBT_EXAMPLES", "10")),
)
settings.load_profile("project")


def pytest_collection_finish() -> None:
    """Thousands of collected tests stay: a collection of garbage need not go through them again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)
