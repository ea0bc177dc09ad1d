"""Messages without ROS."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.support.ros2.messages import installed


@pytest.fixture
def messages() -> Iterator[None]:
    """This Python has the packages of tests/support/ros2/messages.py."""
    with installed():
        yield
