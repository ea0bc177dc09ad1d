"""The workshop with bodies, for tests that need its physics."""

from __future__ import annotations

from typing import Any

import pytest


def needs_world() -> Any:
    """The physics' library; skips the whole file without it."""
    return pytest.importorskip("mujoco", reason="the extra world is not installed: make test-world")
