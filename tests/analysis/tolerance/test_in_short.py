"""What is survived, in one line."""

from __future__ import annotations

from dataclasses import replace

from mrbt_mesh.analysis.tolerance.in_short import survived_losses
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import mission_file


def test_of_a_mission_without_jobs() -> None:
    """The paper's example: both big robots lift the cover."""
    mission = load_mission(mission_file("vehicle_repair"))
    assert survived_losses(mission) == {
        "": "the loss of any one robot (except C1, C2) or of any one capability (except "
        "move_frame on C1, C2)"
    }
    robots = {name: robot for name, robot in mission.robots.items() if name != "C1"}
    found = survived_losses(replace(mission, robots=robots))[""]
    assert found.startswith("nothing: ")
    assert "place_cover" in found


def test_of_each_type_of_jobs() -> None:
    mission = load_mission(mission_file("deliveries"))
    robots = {name: robot for name, robot in mission.robots.items() if name != "D1"}
    found = survived_losses(replace(mission, robots=robots))
    assert found["inspect"] == (
        "the loss of any one robot (except D2) or of any one capability (except look on D2)"
    )
    assert found["deliver"].startswith("the loss of any one robot (except C1, C2, C3, C4)")
