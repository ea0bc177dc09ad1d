"""`mrbt validate`: what a mission holds, and what is wrong with it."""

from __future__ import annotations

import json
from pathlib import Path

from tests.support.command import EXPLORE, REPAIR, done, mrbt, refused


def test_validate_says_what_a_mission_holds() -> None:
    output = done(mrbt("validate", REPAIR))
    assert "valid vehicle_repair: 6 robots, 6 local tasks, 24 global tasks" in output


def test_validate_counts_places(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    travel = "travel: {places: {A: [0, 0], B: [3, 4]}, speed: 1, start: A}\nlocal_tasks:"
    text = Path(EXPLORE).read_text().replace("local_tasks:", travel)
    path.write_text(text.replace("work: 5", "at: $area").replace("program:", "# program:"))
    said = " ".join(done(mrbt("validate", str(path))).split())
    assert "tree nodes, 2 places, no program named" in said


def test_validate_names_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    path.write_text(Path(EXPLORE).read_text().replace("max: 1", "max: 0"))
    problems = refused(mrbt("validate", str(path)))
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if "max: 0" in text)
    assert f"{path}:{line}:" in problems.replace("\n", "")


def test_validate_warns_of_what_is_hardly_meant(tmp_path: Path) -> None:
    """An alternative that never gets its turn, and an action that undoes what led to it."""
    path = tmp_path / "mission.yaml"
    path.write_text(
        """
mission: hand
local_tasks: {pick: {effects: {holding: true}}, place: {effects: {holding: false}}, lift: {}}
conditions: {holding: {}}
robot_types: {T: {capabilities: {pick: 1, place: 1, lift: 1}}}
robots: {R1: T}
global_tasks: {pick: {needs: {pick: {}}}, place: {needs: {place: {}}}, lift: {needs: {lift: {}}}}
tree: {Sequence: [{Fallback: [holding: , pick, lift]}, place]}
""".replace("holding: ,", "{Condition: holding},")
    )
    stuck, undoing = json.loads(done(mrbt("validate", str(path), "--json")))["warnings"]
    assert stuck.startswith("Sequence/Fallback[1]: this Fallback waits for ever")
    assert undoing.startswith(
        "Sequence/place sets holding to false, but an earlier child of Sequence"
    )
    assert json.loads(done(mrbt("analyze", str(path), "--json")))["cautions"] == [stuck, undoing]
    output = done(mrbt("validate", str(path)))
    assert "warning: Sequence/place sets holding" in output.replace("\n", " ")


def test_a_compiled_mission_is_the_same_mission(tmp_path: Path) -> None:
    compiled = tmp_path / "mission.json"
    assert mrbt("validate", REPAIR, "--compile", str(compiled))[0] == 0
    digests = [
        json.loads(mrbt("validate", p, "--json")[1])["digest"] for p in (REPAIR, str(compiled))
    ]
    assert digests[0] == digests[1]
