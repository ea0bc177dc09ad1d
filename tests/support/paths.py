"""Where the project's files are, for tests."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


def mission_file(example: str) -> Path:
    """The mission of an example, e.g. of `vehicle_repair`."""
    return EXAMPLES / example / "mission.yaml"
