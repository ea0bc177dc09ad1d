"""Ten trees of single robots become running teams: docs/data/robot-trees.md."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import pytest

from mrbt_mesh.btcpp.files.check import check_file
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, Schedule, simulate
from tests.support.command import mrbt
from tests.support.paths import ROOT

TREES = ROOT / "examples" / "robot_trees"
S = 1_000_000
# What is said besides the files: that parts do not depend on one another.
OPTIONS = {
    "nav2/patrol": ("--assume-independent", "Sequence"),
    "moveit_pro/clear_table": ("--assume-independent", "TopLevelSequence"),
    "husarion/rounds": ("--assume-independent", "Sequence"),
}
NAMES = sorted(f"{path.parent.name}/{path.stem}" for path in TREES.glob("*/*.xml"))


@dataclass(frozen=True)
class Lifted:
    """One tree as a team's mission, and what the command said."""

    name: str
    mission: Path
    notes: tuple[str, ...]
    units: int

    @property
    def written(self) -> list[Path]:
        """What a user writes for it."""
        folder, stem = TREES / self.name.partition("/")[0], self.name.partition("/")[2]
        files = [folder / "team.yaml", folder / "robot.py", folder / f"{stem}.units.yaml"]
        return [file for file in files if file.is_file()]

    def run(self, robots: int, *, kill: bool = False) -> tuple[str, float]:
        mission = load_mission(self.mission)
        assert mission.program is not None
        names = sorted(mission.robots)
        schedule: Schedule = [(3 * S // 2, Kill(names[0]))] if kill else []
        result = simulate(
            mission,
            load_program(mission.program),
            seed=1,
            robots=names[:robots],
            schedule=schedule,
            timeout_us=200 * S,
        )
        assert result.violations == []
        return str(result.result), float(result.summary["duration_s"])


def lifted(name: str, folder: Path) -> Lifted:
    tree = TREES / f"{name}.xml"
    by_hand = tree.with_suffix(".units.yaml")
    units = str(by_hand) if by_hand.is_file() else "auto"
    mission = folder / "mission.yaml"
    code, out, err = mrbt(
        "tree", "lift", str(tree), "--robots", str(tree.parent / "team.yaml"), "--units", units,
        *OPTIONS.get(name, ()), "-o", str(mission), "--json",
    )  # fmt: skip
    assert code == 0, err
    notes = tuple(line for line in err.splitlines() if line.startswith("note"))
    return Lifted(name, mission, notes, len(json.loads(out)["units"]))


def lines(files: list[Path]) -> int:
    """Lines that are neither empty nor comments."""
    texts = [line.strip() for file in files for line in file.read_text().splitlines()]
    return sum(1 for text in texts if text and not text.startswith("#"))


def nodes(name: str) -> int:
    library, _ = check_file(TREES / f"{name}.xml")
    assert library.main_tree is not None
    return sum(1 for _ in expand(library, library.main_tree).root.walk())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_tree_of_one_robot_runs_in_a_team(name: str, tmp_path: Path) -> None:
    found = lifted(name, tmp_path)
    results = [found.run(1), found.run(3), found.run(3, kill=True)]
    assert [result for result, _ in results] == ["success"] * 3
    times = " | ".join(f"{time_s:.1f}" for _, time_s in results)
    row = f"| {name} | {nodes(name)} | {lines(found.written)} | {found.units} | {times} |"
    text = (ROOT / "docs" / "data" / "robot-trees.md").read_text()
    assert row in text, row
    for note in found.notes:
        message = note.partition(": ")[2].partition(": ")[2].partition(":")[2]
        assert message.split(":")[0].strip()[:40] in text, note


def test_there_are_two_of_each_kind() -> None:
    assert len(NAMES) == 10
    assert len({name.partition("/")[0] for name in NAMES}) == 5
