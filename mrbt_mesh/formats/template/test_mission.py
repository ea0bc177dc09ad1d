"""What the team must do, in virtual time and with faults. Run it with `pytest`."""

import pytest

from mrbt_mesh.testing import Kill, RunMission


def test_every_box_is_moved_and_the_heavy_one_by_two(run_mission: RunMission) -> None:
    run = run_mission("mission.yaml")
    assert run.result == "success"
    carried = {box: len(run.succeeded(f"carry({box})")) for box in ("red", "green", "blue")}
    assert carried == {"red": 1, "green": 2, "blue": 1}


@pytest.mark.parametrize("at_s", [1, 4, 7])
def test_whoever_dies_is_replaced(run_mission: RunMission, at_s: float) -> None:
    run = run_mission("mission.yaml", faults=[(at_s, Kill("P1"))])
    assert run.result == "success"
