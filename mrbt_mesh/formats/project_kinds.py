"""The kinds of projects that `mrbt new` writes for robots without another robot framework."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.plugins import ProgramKind

JOBS = ProgramKind(
    "A team that is handed jobs: travel, a map, a client and a test.",
    Path(__file__).parent / "jobs" / "template",
)
