"""Honest runs that were once accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import honest_recordings


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 49, 57])
def test_a_robot_that_is_alone_may_keep_what_others_could_need(seed: int, tmp_path: Path) -> None:
    _, doubts, _ = honest_recordings._simulated(seed, tmp_path)
    assert doubts == "", f"seed {seed}"
