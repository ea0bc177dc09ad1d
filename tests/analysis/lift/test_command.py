"""`mrbt tree lift`: the example, what it tells, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.btcpp.files.document import Document, read_document
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.mission.mission import SameRobotAs
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim.run import simulate
from tests.support.command import done, mrbt, refused
from tests.support.effort import seeds
from tests.support.paths import ROOT

EXAMPLE = ROOT / "examples" / "lift"
TREE, TEAM = EXAMPLE / "repair.xml", EXAMPLE / "team.yaml"


def run(*arguments: object) -> tuple[int, str, str]:
    return mrbt("tree", "lift", *map(str, arguments))


def told(*arguments: object) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(done(run(*arguments, "--json")))
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


@pytest.mark.parametrize("seed", seeds(3))
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
    err = refused(run(tree, "--robots", TEAM))
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
    assert message in refused(run(TREE, "--robots", team))


def test_an_unknown_node_is_not_assumed_independent() -> None:
    err = refused(run(TREE, "--robots", TEAM, "--assume-independent", "prats"))
    assert "no node has the path or name 'prats'" in err


# -- what belongs to a robot ------------------------------------------------------------------

CARRY = """
local_tasks:
  pick: {parameters: [item], requires: {}, effects: {holding($item): true}, uses: [gripper]}
  carry: {parameters: [item], requires: {holding($item): true}, writes: [place($item)]}
  place:
    parameters: [item]
    requires: {holding($item): true}
    effects: {holding($item): false}
    uses: [gripper]
conditions: {holding: {parameters: [item], per: robot}}
resources: {gripper: {per: robot}}
robot_types:
  Arm: {capabilities: {pick: 1, carry: 1, place: 1}}
robots: {R1: Arm, R2: Arm}
"""
TWO_ITEMS = "".join(
    f'<Action ID="{task}" item="{item}"/>' for item in (1, 2) for task in ("pick", "carry", "place")
)


def written(folder: Path, team: str, nodes: str) -> tuple[int, str, Path]:
    """Lift a Sequence of these nodes: exit status, messages, and the mission."""
    (folder / "team.yaml").write_text(team)
    (folder / "tree.xml").write_text(
        f'<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence>{nodes}</Sequence>'
        "</BehaviorTree></root>"
    )
    output = folder / "mission.yaml"
    code, out, err = run(folder / "tree.xml", "--robots", folder / "team.yaml", "--output", output)
    return code, out + err, output


def test_what_a_robot_holds_is_carried_and_placed_by_it(tmp_path: Path) -> None:
    """What cannot be begun again: when the first one has it, there is nothing left to pick."""
    gone = "requires: {there($item): true}, effects: {holding($item): true, there($item): false}"
    team = CARRY.replace("requires: {}, effects: {holding($item): true}", gone)
    team = team.replace("per: robot}}\nres", "per: robot}, there: {parameters: [item]}}\nres")
    code, text, output = written(tmp_path, team, TWO_ITEMS)
    assert code == 0, text
    tasks = load_mission(output).global_tasks
    for item in "12":
        for name in ("carry", "place"):
            (need,) = tasks[f"{name}({item})"].needs
            assert need.same_robot_as == SameRobotAs(f"pick({item})", f"pick({item})")


def test_what_can_be_begun_again_is_where_the_robot_dies(tmp_path: Path) -> None:
    code, text, output = written(tmp_path, CARRY, TWO_ITEMS)
    assert code == 0, text
    mission = load_mission(output)
    assert not [n for t in mission.global_tasks.values() for n in t.needs if n.same_robot_as]
    asked = {n.subject for n in mission.tree.nodes if n.kind is Kind.CONDITION}
    assert asked == {"holding(1)", "holding(2)"}


def test_conditions_that_tell_why_something_failed_are_the_missions_too(tmp_path: Path) -> None:
    told = "stuck: {parameters: [item], failure_reason: {global_task: pick($item), contains: jam}}"
    team = CARRY.replace("per: robot}}\nres", f"per: robot}}, {told}}}\nres")
    code, text, output = written(tmp_path, team, TWO_ITEMS)
    assert code == 0, text
    mission = load_mission(output)
    assert mission.conditions_after_end("pick(1)", "pick(1)", False, "a jam") == [
        ("stuck(1)", True)
    ]


@pytest.mark.parametrize(
    ("resources", "arrangement"),
    [
        ("resources: {gripper: {per: robot}}", "(pick(1) ; carry(1) ; place(1)) | "),
        ("resources: {gripper: {per: team}}", "pick(1) ; "),
        ("", "pick(1) ; "),
    ],
)
def test_robots_use_their_own_grippers_at_once(
    tmp_path: Path, resources: str, arrangement: str
) -> None:
    team = CARRY.replace("resources: {gripper: {per: robot}}", resources)
    assert arrangement in done(written(tmp_path, team, TWO_ITEMS))


@pytest.mark.parametrize(
    ("nodes", "reason"),
    [
        (
            '<Fallback><Action ID="pick" item="1"/><Action ID="pick" item="2"/></Fallback>'
            '<Action ID="place" item="1"/>',
            "pick(1) need not have been done before it",
        ),
        ('<Action ID="place" item="1"/>', "nothing before it makes holding(1) true"),
    ],
)
def test_where_nobody_can_tell_whose_it_is_the_command_says_so(
    tmp_path: Path, nodes: str, reason: str
) -> None:
    code, text, output = written(tmp_path, CARRY, nodes)
    assert code == 0, text
    assert reason in " ".join(text.split())
    needs = load_mission(output).global_tasks["place(1)"].needs
    assert [need.same_robot_as for need in needs] == [None]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("carry: 1, ", "", "nobody can do carry(1): none of R1, R2 has the capability carry"),
        (
            "{R1: Arm, R2: Arm}",
            "{R1: {type: Arm, capabilities: {place: null}}, "
            "R2: {type: Arm, capabilities: {pick: null}}}",
            "place(1) requires holding(1) of the robot that did pick(1), but none can do both "
            "(pick(1): R1; place(1): R2)",
        ),
        ("gripper: {per: robot}", "gripper: {per: arm}", "per"),
    ],
)
def test_a_team_that_cannot_do_it_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in CARRY
    code, text, _ = written(tmp_path, CARRY.replace(old, new), TWO_ITEMS)
    assert code == 2
    assert message in " ".join(text.split())


def test_subtrees_and_models_in_other_files(tmp_path: Path) -> None:
    """The example in three files is lifted to the same mission; without them it is refused."""
    document = read_document(TREE)
    main, fix, models = document.root.children
    for name, parts in {"repair": [main], "trees/fix": [fix], "models": [models]}.items():
        path = tmp_path / f"{name}.xml"
        path.parent.mkdir(exist_ok=True)
        root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": "Repair"}, parts)
        path.write_text(Document(str(path), [root]).text())
    (tmp_path / "trees" / "package.xml").write_text("<package/>")
    arguments = (tmp_path / "repair.xml", "--robots", TEAM)
    others = ("--models", tmp_path / "models.xml", "--trees", tmp_path / "trees")
    assert told(*arguments, *others)["decisions"] == told(TREE, "--robots", TEAM)["decisions"]
    assert "there is no tree 'FixPart'" in refused(run(*arguments))
    assert "there is no such folder" in refused(run(*arguments, "--trees", tmp_path / "nowhere"))
    assert run(*arguments, "--models", tmp_path / "nothing.xml")[0] == 2


def test_a_condition_of_the_team_file_needs_no_model(tmp_path: Path) -> None:
    tree, mission = tmp_path / "tree.xml", tmp_path / "mission.yaml"
    tree.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Fallback><screwed/><place_screws/>'
        "</Fallback></BehaviorTree></root>"
    )
    assert run(tree, "--robots", TEAM, "-o", mission)[0] == 0
    kinds = [node.kind for node in load_mission(mission).tree.nodes]
    assert kinds == [Kind.FALLBACK, Kind.CONDITION, Kind.ACTION]
