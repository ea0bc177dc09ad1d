"""Tests on real processes: their marks, and the team of a test."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.team import TEST_TIMEOUT_S, Team


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """All tests in this folder start processes; one that hangs is ended."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.processes)
            if item.get_closest_marker("timeout") is None:
                item.add_marker(pytest.mark.timeout(TEST_TIMEOUT_S))


@pytest.fixture
def team(tmp_path: Path) -> Iterator[Team]:
    """A team that is ended whatever happens."""
    with Team(tmp_path) as found:
        yield found
