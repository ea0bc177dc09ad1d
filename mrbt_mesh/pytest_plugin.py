"""The fixture `run_mission`, which pytest finds wherever this package is installed.

Every pytest session there loads this module, so it loads nothing before the fixture is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from mrbt_mesh.runtime.program import RobotProgram
    from mrbt_mesh.testing import MissionRun, RunMission
    from mrbt_mesh.testing_commands import File


@pytest.fixture
def run_mission(request: pytest.FixtureRequest) -> RunMission:
    """Run `mrbt_mesh.testing.run`; paths are relative to the folder of the test's file."""
    from mrbt_mesh.testing import run
    from mrbt_mesh.testing_commands import beside as commands_beside

    folder = request.path.parent

    def beside(mission: File, program: RobotProgram | str | None = None, **more: Any) -> MissionRun:
        if isinstance(program, str):
            program = str(folder / program)
        more["commands"] = list(commands_beside(folder, more.get("commands", ())))
        return run(folder / mission, program, **more)

    return beside
