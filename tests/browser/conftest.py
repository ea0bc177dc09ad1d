"""A team and a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.support.browser import chromium
from tests.support.team import Team

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for the tests of a file; each opens windows of its own.

    It ends with the file: while it runs, no other event loop can run in this thread.
    """
    with chromium() as found:
        yield found


@pytest.fixture
def team(tmp_path: Path) -> Iterator[Team]:
    """A team that is ended whatever happens."""
    with Team(tmp_path) as found:
        yield found
