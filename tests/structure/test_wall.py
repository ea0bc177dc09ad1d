"""The mesh runs where the periphery is deleted: its packages, tests, entry points' modules."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.mesh_alone import copy_mesh, run

# Of each package some, which load and run missions; `make test-mesh` runs all.
SOME = (
    "tests/cli/commands/test_plan.py",
    "tests/core/agent/test_agent_scripts.py",
    "tests/formats/test_mission_file.py",
    "tests/recording/test_robot_recorder.py",
    "tests/runtime/test_program_loader.py",
    "tests/sim/test_run_account.py",
    "tests/sim/test_run_bids.py",
)
# Tests of a mesh package that use the periphery as well: as few as can be.
MOST_LEFT_OUT = 10


@pytest.mark.slow
def test_the_mesh_passes_its_tests_without_the_periphery(tmp_path: Path) -> None:
    packages = ("core", "drills", "formats", "observer", "recording", "runtime", "sim")
    left_out = [name for name in copy_mesh(tmp_path) if name.split("/")[1] in packages]
    assert len(left_out) <= MOST_LEFT_OUT, left_out
    (tmp_path / "tests" / "test_where.py").write_text(
        "from pathlib import Path\n\nimport mrbt_mesh\n\n"
        "def test_the_copy_is_tested():\n"
        f"    assert Path(mrbt_mesh.__file__).is_relative_to({str(tmp_path)!r})\n"
    )
    assert run(tmp_path, (*SOME, "tests/test_where.py"), "-x").returncode == 0
