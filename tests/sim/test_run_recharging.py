"""The recipe of docs/how-to/conditions.md for robots whose batteries get low, with faults."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mrbt_mesh.testing import Fault, Kill, MissionRun, run
from tests.support.paths import ROOT


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    page = (ROOT / "docs/how-to/conditions.md").read_text()
    text = page.partition("### Example: charge")[2].partition("\n## ")[0]
    blocks = dict(re.findall(r"```(yaml|python)\n(.*?)```", text, re.DOTALL))
    (tmp_path / "robot.py").write_text(blocks["python"])
    (tmp_path / "mission.yaml").write_text(blocks["yaml"])
    return tmp_path / "mission.yaml"


def lows(found: MissionRun) -> list[str]:
    return [fault.robot for fault in found.faults if fault.reason == "the battery is low"]


def test_low_robots_charge_one_after_the_other_and_the_others_take_over(mission: Path) -> None:
    found = run(mission)
    assert found.result == "success"
    assert lows(found) == ["R1", "R2"]
    # What they were at was cancelled and done by somebody else; each charged once, and only they.
    assert sorted(found.cancelled("deliver")) == ["R1", "R2"]
    assert found.started("charge") == found.succeeded("charge") == ["R1", "R2"]
    assert len(found.succeeded("deliver")) == 6
    assert all(fault.until_s is not None for fault in found.faults)


@pytest.mark.parametrize("at_s", [7.0, 12.0])
def test_a_robot_that_dies_while_it_is_low_is_not_waited_for(mission: Path, at_s: float) -> None:
    """Before or after it has begun to charge."""
    faults: list[tuple[float, Fault]] = [(at_s, Kill("R1"))]
    found = run(mission, faults=faults)
    assert found.result == "success"
    assert found.succeeded("charge") == ["R2"]
    assert len(found.succeeded("deliver")) == 6
