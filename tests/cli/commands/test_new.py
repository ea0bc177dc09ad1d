"""`mrbt new`: a mission and a robot that run at once."""

from __future__ import annotations

from pathlib import Path

from tests.support.command import mrbt


def test_new_writes_a_valid_mission_and_spares_what_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "my_team"
    code, output, _ = mrbt("new", str(folder))
    assert code == 0
    assert "mrbt up" in output
    assert mrbt("validate", str(folder / "mission.yaml"))[0] == 0
    code, _, problems = mrbt("new", str(folder))
    assert code == 2
    assert str(folder) in problems.replace("\n", "")
