"""`mrbt analyze`: JSON, the report for people, costs, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from tests.support.command import EXPLORE, REPAIR, done, mrbt, refused
from tests.support.paths import mission_file


def test_json_holds_the_documented_keys() -> None:
    code, output, _ = mrbt("analyze", REPAIR, "--json")
    data = json.loads(output)
    assert code == 0
    assert (data["weakly_fault_tolerant"], data["strongly_fault_tolerant"]) == (False, False)
    assert (data["major"]["max_tolerated"], data["minor"]["max_tolerated"]) == (3, 11)
    docs = (Path(REPAIR).parents[2] / "docs" / "data" / "analyze-json.md").read_text()
    for key in (*data, *data["major"], *data["tasks"][0]):
        assert f"`{key}`" in docs, key


def test_the_report_names_what_matters() -> None:
    output = done(mrbt("analyze", REPAIR))
    for part in ("move_frame on C1, C2", "survives", "fatal from", "1 x C", "Assumed"):
        assert part in output
    assert max(map(len, output.splitlines())) <= 200


def test_it_says_that_side_constraints_are_left_out(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    text = Path(REPAIR).read_text() + "\nconstraints: {at_most: [{robots: [A1, A2]}]}\n"
    mission.write_text(text)
    said = "(at most 1 of A1, A2 at work) are NOT taken into account"
    _, output, _ = mrbt("analyze", str(mission))
    assert " ".join(output.split()).count(said) == 2
    _, output, _ = mrbt("analyze", str(mission), "--json")
    assert said in json.loads(output)["assumptions"][0]
    _, output, _ = mrbt("analyze", REPAIR)
    assert "NOT taken" not in output


def test_costs_come_from_the_mission_and_from_a_file_of_their_own(tmp_path: Path) -> None:
    mission = tmp_path / "mission.yaml"
    text = Path(REPAIR).read_text().replace("../../agents", str(Path(REPAIR).parents[2] / "agents"))
    text = text.replace("  move_frame: {work: 2}", "  move_frame: {work: 2, cost: 9}")
    mission.write_text(text.replace("  C:    # big, two arms\n", "  C:\n    cost: 7\n"))
    loaded = load_mission(mission)
    assert loaded.costs.robot("C") == 7
    assert (loaded.costs.capability("move_frame"), loaded.costs.robot("A")) == (9, 1)
    assert loaded.digest == load_mission(Path(REPAIR)).digest
    compiled = tmp_path / "mission.json"
    compiled.write_text(compile_mission(loaded))
    assert load_mission(compiled).costs == loaded.costs
    data = json.loads(compiled.read_text())
    compiled.write_text(json.dumps(data | {"costs": {"robots": {"C": -1}}}))
    assert "cost of C: -1" in mrbt("analyze", str(compiled))[2]

    def advice(*arguments: str) -> tuple[int, int]:
        output = done(mrbt("analyze", *arguments, "--json"))
        found = json.loads(output)["advice"]["strongly_fault_tolerant"]
        return found["robots_only"]["cost"], found["capabilities_only"]["cost"]

    assert advice(str(mission)) == (7, 9)
    costs = tmp_path / "costs.yaml"
    costs.write_text("robot_types: {C: 30}\nlocal_tasks: {move_frame: 4}\n")
    assert advice(str(mission), "--costs", str(costs)) == (30, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("robot_types: {D: 3}\n", "costs.yaml:1: robot_types/D: the mission has no robot type 'D'"),
        ("\nlocal_tasks: {lift: 3}\n", "costs.yaml:2: local_tasks/lift: the mission has no local"),
        ("robot_types: {explorer: -1}\n", "a number of at least 0 is expected"),
        ("robot_types: {explorer: 1.5}\n", "a whole number is expected"),
        ("robots: {}\n", "unknown key 'robots'; did you mean 'robot_types'?"),
        ("[1]\n", "robot_types: ... is expected, found a list"),
        ("robot_types: {explorer: [\n", "not valid YAML"),
    ],
)
def test_bad_costs_are_a_message_and_status_2(tmp_path: Path, text: str, message: str) -> None:
    costs = tmp_path / "costs.yaml"
    costs.write_text(text)
    assert message in refused(mrbt("analyze", EXPLORE, "--costs", str(costs)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("nowhere.yaml",), "there is no such file"),
        ((EXPLORE, "--costs", "nowhere.yaml"), "there is no such file"),
        ((EXPLORE, "--limit", "0"), "0.1"),
    ],
)
def test_bad_input_is_a_message_and_status_2(arguments: tuple[str, ...], message: str) -> None:
    assert message in refused(mrbt("analyze", *arguments))


def test_a_mission_with_jobs_is_analyzed_by_types() -> None:
    mission = str(mission_file("deliveries"))
    output = done(mrbt("analyze", mission))
    assert "each type of jobs on its own" in output
    assert "deliveries: one job inspect(dock_1)" in output
    data = json.loads(done(mrbt("analyze", mission, "--json")))
    assert data["mission"] == "deliveries"
    assert data["jobs"]["inspect"]["strongly_fault_tolerant"]
    assert data["jobs"]["deliver"]["scarce"] == ["put"]
