"""Ten trees of single robots become running teams: docs/data/robot-trees.md."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, Schedule, simulate
from tests.support.command import done, mrbt
from tests.support.paths import ROOT

TREES = ROOT / "examples" / "robot_trees"
S = 1_000_000
NAMES = sorted(f"{path.parent.name}/{path.stem}" for path in TREES.glob("*/*.xml"))


def run(folder: Path, robots: int, *, kill: bool = False) -> float:
    """The seconds that a run takes, which has to succeed."""
    mission = load_mission(folder / "mission.yaml")
    assert mission.program is not None
    names = sorted(mission.robots)
    schedule: Schedule = [(3 * S // 2, Kill(names[0]))] if kill else []
    program = load_program(mission.program)
    result = simulate(mission, program, seed=1, robots=names[:robots], schedule=schedule)
    assert (result.result, result.violations) == ("success", [])
    return float(result.summary["duration_s"])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_tree_of_one_robot_runs_in_a_team(name: str, tmp_path: Path) -> None:
    tree, folder = TREES / f"{name}.xml", tmp_path / "new"
    words = ("--program", str(tree.with_name("robot.py")), "--json")
    tasks = json.loads(done(mrbt("tree", "lift", str(tree), str(folder), *words)))["tasks"]
    times = [run(folder, 1), run(folder, 3), run(folder, 3, kill=True)]
    row = f"| {name} | {len(tasks)} | {' | '.join(f'{time_s:.1f}' for time_s in times)} |"
    assert row in (ROOT / "docs" / "data" / "robot-trees.md").read_text(), row


def test_there_are_two_of_each_kind() -> None:
    assert len(NAMES) == 10
    assert len({name.partition("/")[0] for name in NAMES}) == 5
