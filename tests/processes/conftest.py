"""The team of a test on real processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.team import Team


@pytest.fixture
def team(tmp_path: Path) -> Iterator[Team]:
    """A team that is ended whatever happens."""
    with Team(tmp_path) as found:
        yield found
