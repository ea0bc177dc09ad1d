"""What comes with the project is found in a clone, and in an installed package."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.formats import shipped as module
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.shipped import UnknownExampleError, example_mission, examples, shipped
from tests.support.paths import ROOT


def test_in_a_clone_it_is_beside_the_package() -> None:
    for folder in ("agents", "drills", "examples"):
        assert shipped(folder) == ROOT / folder


def test_in_an_installed_package_it_is_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "__file__", str(tmp_path / "mrbt_mesh" / "formats" / "shipped.py"))
    (tmp_path / "examples").mkdir()
    assert shipped("examples") == tmp_path / "examples"
    inside = tmp_path / "mrbt_mesh" / "share" / "examples"
    (inside / "walk").mkdir(parents=True)
    (inside / "walk" / "mission.yaml").touch()
    (inside / "no_mission").mkdir()
    assert shipped("examples") == inside
    assert examples() == ["walk"]


def test_every_example_has_a_mission_that_finds_its_program() -> None:
    assert {"couriers", "lift", "vehicle_repair"} <= set(examples())
    for name in examples():
        mission = load_mission(example_mission(name))
        assert mission.program is not None
        assert Path(mission.program).is_file()


def test_an_unknown_example_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownExampleError, match="no example 'courier'; did you mean 'couriers'"):
        example_mission("courier")
    with pytest.raises(UnknownExampleError, match="known: assembly, couriers, dispense, explore"):
        example_mission("../drills")
