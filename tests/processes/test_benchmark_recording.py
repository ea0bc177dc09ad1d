"""The benchmark of recording measures robots whose plans change."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import recording


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_every_robot_is_measured(tmp_path: Path) -> None:
    found = recording.measure_in(tmp_path, robots=2, seconds=8.0)
    assert found["plan_changes_per_s"] > 0
    assert 0 < found["recorder_share"] <= found["highest_share"] < 1
