"""`mrbt validate`: what a mission holds, and what is wrong with it."""

from __future__ import annotations

import json
from pathlib import Path

from tests.support.command import EXPLORE, REPAIR, mrbt


def test_validate_says_what_a_mission_holds() -> None:
    code, output, _ = mrbt("validate", REPAIR)
    assert code == 0
    assert "valid vehicle_repair: 6 robots, 6 local tasks, 24 global tasks" in output


def test_validate_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(Path(EXPLORE).read_text().replace("max: 1", "max: 0"))
    code, output, problems = mrbt("validate", str(path))
    assert (code, output) == (2, "")
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "max: 0" in text)
    assert f"{path}:{line}:" in problems.replace("\n", "")


def test_a_compiled_mission_is_the_same_mission(tmp_path: Path) -> None:
    compiled = tmp_path / "mission.json"
    assert mrbt("validate", REPAIR, "--compile", str(compiled))[0] == 0
    digests = [
        json.loads(mrbt("validate", p, "--json")[1])["digest"] for p in (REPAIR, str(compiled))
    ]
    assert digests[0] == digests[1]
