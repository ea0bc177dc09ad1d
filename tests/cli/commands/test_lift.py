"""`mrbt lift`: the example, what it tells, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.run import simulate
from tests.support.command import mrbt
from tests.support.paths import ROOT

EXAMPLE = ROOT / "examples" / "lift"
TREE, TEAM = EXAMPLE / "repair.xml", EXAMPLE / "team.yaml"


def run(*arguments: object) -> tuple[int, str, str]:
    return mrbt("lift", *map(str, arguments))


def told(*arguments: object) -> dict[str, Any]:
    code, out, err = run(*arguments, "--json")
    assert code == 0, err
    data: dict[str, Any] = json.loads(out)
    return data


def test_the_committed_mission_is_what_the_command_writes(tmp_path: Path) -> None:
    """Lifted again in a copy of its folder, since paths in it are relative."""
    folder = tmp_path / "examples" / "lift"
    folder.mkdir(parents=True)
    for file in (TREE, TEAM):
        (folder / file.name).write_text(file.read_text())
    written = folder / "mission.yaml"
    assert run(folder / TREE.name, "--robots", folder / TEAM.name, "-o", written)[0] == 0
    assert written.read_text() == (EXAMPLE / "mission.yaml").read_text()


@pytest.mark.parametrize("seed", range(3))
def test_six_robots_are_faster_by_what_the_longest_chain_allows(seed: int) -> None:
    predicted = told(TREE, "--robots", TEAM)["factor"]
    mission = load_mission(EXAMPLE / "mission.yaml")
    assert mission.program is not None
    program = load_program(mission.program)
    alone = simulate(mission, program, seed=seed, robots=["R1"])
    team = simulate(mission, program, seed=seed)
    assert alone.result == team.result == "success"
    assert team.violations == []
    factor = alone.summary["duration_s"] / team.summary["duration_s"]
    assert factor >= 0.9 * predicted, f"{factor:.2f} of {predicted}"


def test_every_decision_is_explained() -> None:
    data = told(TREE, "--robots", TEAM)
    decisions = {decision["path"]: decision for decision in data["decisions"]}
    diagnosis = decisions["repair/diagnosis[3]"]
    assert diagnosis["parallel"]
    assert diagnosis["arrangement"] == " | ".join(f"diagnose({k})" for k in range(1, 6))
    whole = decisions["repair"]
    assert not whole["parallel"]
    assert {
        "first": "remove_screws",
        "second": "remove_cover",
        "reason": "both touch screwed",
        "added": False,
    } in whole["dependences"]
    _, out, _ = run(TREE, "--robots", TEAM)
    assert "at most 3.00 times faster" in out


def test_annotations_in_the_tree_count_as_well(tmp_path: Path) -> None:
    tree = tmp_path / "tree.xml"
    tree.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence name="all" _independent="{}">'
        '<Action ID="a" _writes="x"/><Action ID="b" _effects="done; !open" _reads="x"/>'
        '<Action ID="c" {}/></Sequence></BehaviorTree></root>'.format("false", '_may_fail="false"')
    )
    team = tmp_path / "team.yaml"
    team.write_text(
        "local_tasks: {a: {}, b: {}, c: {}}\n"
        "robot_types: {T: {capabilities: {a: 1, b: 1, c: 1}}}\nrobots: {R1: T, R2: T}\n"
    )
    (decision,) = told(tree, "--robots", team)["decisions"]
    assert decision["arrangement"] == "(a ; b) | c"
    tree.write_text(tree.read_text().replace('"false">', '"true">').replace(" _may_fail", " _x"))
    (decision,) = told(tree, "--robots", team)["decisions"]
    assert decision["arrangement"] == "(a ; b) | c"
    assert decision["notes"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('ID="solder"', 'ID="glue"', "action 'glue' is no local task"),
        ('<Action ID="place_cover"/>', '<Script code="a := 1"/>', "repair.xml:23: Repair/repair"),
        ("</BehaviorTree>", "", "not well-formed XML"),
    ],
)
def test_what_a_team_cannot_carry_out_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    tree = tmp_path / "repair.xml"
    tree.write_text(TREE.read_text().replace(old, new))
    code, _, err = run(tree, "--robots", TEAM)
    assert code == 2
    assert message in err.replace("\n", " ") or message in err
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("local_tasks:", "tree: solder\nlocal_tasks:", "a team file has no tree"),
        (
            "diagnosed($part): true}\n  replace",
            "diagnosed($k): true}\n  replace",
            "unknown parameter",
        ),
        ("work: 3,", "work: -3,", "team.yaml"),
        ("robots: {R1", "robot: {R1", "robot"),
    ],
)
def test_a_team_file_with_problems_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    team = tmp_path / "team.yaml"
    text = TEAM.read_text()
    assert old in text
    team.write_text(text.replace(old, new, 1))
    code, _, err = run(TREE, "--robots", team)
    assert code == 2
    assert message in err


def test_an_unknown_node_is_not_assumed_independent() -> None:
    code, _, err = run(TREE, "--robots", TEAM, "--assume-independent", "prats")
    assert code == 2
    assert "no node has the path or name 'prats'" in err
