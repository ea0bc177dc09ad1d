"""`mrbt tree lift --units`: what is written, what is told, and what is refused."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, simulate
from tests.support.command import done, mrbt, refused

TREE = """<root BTCPP_format="4" main_tree_to_execute="Round">
  <BehaviorTree ID="Round">
    <Sequence>
      <SubTree ID="Look" place="dock"/>
      <SubTree ID="Look" place="1.5;2.0;0"/>
      <Report to="{office}" text="all seen"/>
      <Fallback>
        <Quiet/>
        <Hoot/>
      </Fallback>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Look">
    <Sequence>
      <Plan goal="{place}" path="{path}"/>
      <Follow path="{path}"/>
    </Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="Plan"><input_port name="goal"/><output_port name="path"/></Action>
    <Action ID="Follow"><input_port name="path"/></Action>
    <Action ID="Report"><input_port name="to"/><input_port name="text"/></Action>
  </TreeNodesModel>
</root>
"""
TEAM = """
program: robot.py
local_tasks:
  Plan: {work: 1, writes: [world]}
  Follow: {work: 4, writes: [world]}
  Report: {writes: [world]}
  Hoot: {writes: [world]}
parameters: {office: "red;blue"}
conditions: {Quiet: {}}
robot_types:
  Cart: {capabilities: {Plan: 2, Follow: 1}}
  Horn: {capabilities: {Hoot: 1, Report: 1}}
robots: {C1: Cart, C2: Cart, H1: Horn}
"""
PROGRAM = """
import anyio
from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.btcpp import Out
robot = RobotProgram(record_work=True)
@robot.action("Plan")
async def plan(goal: str, path: Out[str]) -> None:
    path.set(f"to {goal}")
@robot.action("Follow")
async def follow(path: str) -> None:
    assert path in ("to dock", "to 1.5;2.0;0")
    await anyio.sleep(1)
@robot.action("Report")
def report(to: str, text: str) -> bool:
    return (to, text) == ("red;blue", "all seen")
@robot.action("Hoot")
def hoot() -> None: ...
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "tree.xml").write_text(TREE)
    (tmp_path / "team.yaml").write_text(TEAM)
    (tmp_path / "robot.py").write_text(PROGRAM)
    return tmp_path


def run(folder: Path, *arguments: str, units: str = "auto") -> tuple[int, str, str]:
    files = (folder / "tree.xml", "--robots", folder / "team.yaml", "--units", units)
    return mrbt("tree", "lift", *map(str, files), *arguments)


def told(folder: Path, units: str = "auto") -> dict[str, Any]:
    data: dict[str, Any] = json.loads(done(run(folder, "--json", units=units)))
    return data


def by_hand(folder: Path, text: str) -> str:
    path = folder / "units.yaml"
    path.write_text(text)
    return str(path)


def test_what_is_written_runs(folder: Path) -> None:
    code, _, err = run(folder, "-o", str(folder / "mission.yaml"))
    assert (code, err) == (0, "")
    mission = load_mission(folder / "mission.yaml")
    assert mission.program is not None
    assert sorted(mission.program_trees) == ["Hoot", "Look(dock)", "Look_2", "Report"]
    assert mission.robots["C1"].capabilities == {"Look": 1_111_111, "Look_2": 1_111_111}
    result = simulate(mission, load_program(mission.program), seed=1)
    assert result.result == "success"


def test_units_and_cuts_are_told_with_their_reasons(folder: Path) -> None:
    data = told(folder)
    assert [(unit["call"], unit["tree"]) for unit in data["units"]] == [
        ("Look(dock)", "Look"),
        ("Look_2", "Look"),
        ("Report", "Report_unit"),
        ("Hoot", "Hoot_unit"),
    ]
    assert data["units"][0]["reasons"] == ["the entry 'path': Plan writes it, Follow reads it"]
    assert data["cuts"][0] == {
        "path": "Round/Sequence",
        "first": "Look",
        "second": "Look",
        "reason": "as declared, they share nothing of one robot; they share no entry",
    }
    out = done(run(folder))
    assert "together: the entry 'path': Plan writes it, Follow reads it" in out
    assert "Quiet is known to the whole team" in out


def test_a_split_by_hand(folder: Path) -> None:
    units = by_hand(folder, "units: {tell: [Report, Fallback], patrol: [Look, Look]}")
    data = told(folder, units)["units"]
    assert [unit["call"] for unit in data] == ["patrol", "tell"]
    assert data[0]["reasons"] == ["the unit 'patrol' by hand: Look, Look"]
    units = by_hand(folder, "units: {visit: [Look]}")
    calls = [unit["call"] for unit in told(folder, units)["units"]]
    assert calls == ["visit(dock)", "visit_2", "Report", "Hoot"]
    units = by_hand(folder, 'units: {first: ["Round/Sequence/Look:4"]}')
    calls = [unit["call"] for unit in told(folder, units)["units"]]
    assert calls == ["first(dock)", "Look", "Report", "Hoot"]
    units = by_hand(folder, "units: {all: [Report, Look]}")
    err = refused(run(folder, units=units))
    assert "no robot can do all of the unit all: C1 lacks Report" in err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("units: {a: [Repotr]}", "no node has the path or name 'Repotr'; did you mean 'Report'?"),
        ("units: {a: [Round/Report]}", "no node has the path or name 'Round/Report'"),
        ("units: {a: [Report], b: [Report]}", "is in the unit 'a', too"),
        (
            "units: {a: [Plan], b: [Follow]}",
            "'a' and 'b' cannot be separate units: the entry 'path'",
        ),
        ("units: {a: []}", "units.yaml"),
        ("unit: {a: [Plan]}", "unit"),
        ("[]", "units are expected"),
    ],
)
def test_a_split_that_cannot_be(folder: Path, text: str, message: str) -> None:
    err = refused(run(folder, units=by_hand(folder, text)))
    assert message in err.replace("\n", " ")
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("units", "message"),
    [("yes", "is neither auto nor a file"), ("none.yaml", "none.yaml")],
)
def test_units_are_auto_or_a_file(folder: Path, units: str, message: str) -> None:
    assert message in refused(run(folder, units=units))


def test_names_of_nodes_become_names_that_a_mission_may_have(folder: Path) -> None:
    tree = folder / "tree.xml"
    name = "one/two " * 20
    tree.write_text(TREE.replace("<Sequence>", f'<Sequence name="{name}">', 1))
    done(run(folder, "-o", str(folder / "mission.yaml")))
    assert load_mission(folder / "mission.yaml").tree.nodes[0].name == ("one-two " * 20)[:64]


def test_a_subtree_that_is_nowhere(folder: Path) -> None:
    tree = folder / "tree.xml"
    tree.write_text(TREE.replace('<BehaviorTree ID="Look">', '<BehaviorTree ID="Watch">'))
    assert "tree.xml:4: Round/Sequence/Look: there is no tree 'Look'" in refused(run(folder))
    other = folder / "look.xml"
    other.write_text(TREE.replace(' main_tree_to_execute="Round"', ""))
    assert run(folder, "--models", str(other))[0] == 0


def test_what_a_team_lacks_is_told(folder: Path) -> None:
    team = folder / "team.yaml"
    team.write_text(
        TEAM.replace('parameters: {office: "red;blue"}', "").replace(
            "  Hoot: {writes: [world]}\n", ""
        )
    )
    code, _, err = run(folder)
    assert code == 0
    assert "Report reads it and nothing in the tree writes it" in err
    assert "every robot is taken to have them: Hoot" in err
    team.write_text(
        TEAM.replace("Follow: 1", "Follow: 0.5").replace("C2: Cart, H1: Horn", "C2: Cart")
    )
    err = refused(run(folder))
    assert "no robot can do all of the unit Report: C1 lacks Report; C2 lacks Report" in err


def test_what_depends_on_an_argument_that_is_not_known_yet(folder: Path) -> None:
    team = folder / "team.yaml"
    declares = "Follow: {parameters: [path], writes: [floor($path)], work: 4}\n  Plan: {reads: []}"
    team.write_text(
        TEAM.replace(
            "Plan: {work: 1, writes: [world]}\n  Follow: {work: 4, writes: [world]}", declares
        )
    )
    code, _, err = run(folder)
    assert code == 0
    assert "Follow declares something of $path" in err


CARRY = """
local_tasks:
  pick: {parameters: [item], requires: {}, effects: {holding($item): true}, uses: [gripper]}
  place:
    parameters: [item]
    requires: {holding($item): true}
    effects: {holding($item): false}
    uses: [gripper]
conditions: {holding: {parameters: [item], per: robot}}
resources: {gripper: {per: robot}}
robot_types: {Arm: {capabilities: {pick: 1, place: 1}}}
robots: {R1: Arm, R2: Arm}
"""


def test_what_a_robot_holds_stays_with_it_until_it_is_put_down(folder: Path) -> None:
    """And units that declare what they do go in parallel."""
    nodes = "".join(f'<{task} item="{k}"/>' for k in (1, 2) for task in ("pick", "place"))
    (folder / "tree.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence>'
        f"{nodes}</Sequence></BehaviorTree></root>"
    )
    (folder / "team.yaml").write_text(CARRY)
    data = told(folder)
    assert [unit["call"] for unit in data["units"]] == ["pick_to_place", "pick_to_place_2"]
    assert data["units"][0]["reasons"][0] == "the robot's own condition 'holding': pick, place"


FETCH = """<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence{0}>
<Say what="hello"/><NavigateTo at="a"/><Say what="there"/><Grasp/><NavigateTo at="b"/><Release/>
</Sequence></BehaviorTree></root>"""
FETCH_TEAM = """
program: robot.py
local_tasks: {%s}
conditions: {at: {per: robot}, full: {per: robot}}
robot_types: {Cart: {capabilities: {Say: 1, NavigateTo: 1, Grasp: 1, Release: 1}}}
robots: {C1: Cart, C2: Cart, C3: Cart}
"""
# A robot that grasps where it never was, or releases what it never held, says so by failing.
FETCH_PROGRAM = """
import anyio
from mrbt_mesh import RobotProgram, TaskContext
robot = RobotProgram(record_work=True)
at, full = {}, set()
@robot.action("NavigateTo")
async def navigate_to(task: TaskContext, at: str) -> None:
    await anyio.sleep(1)
    globals()["at"][task.robot] = at
@robot.action("Grasp")
async def grasp(task: TaskContext) -> bool:
    await anyio.sleep(1)
    full.add(task.robot)
    return at.get(task.robot) == "a"
@robot.action("Release")
async def release(task: TaskContext) -> bool:
    await anyio.sleep(1)
    return at.get(task.robot) == "b" and task.robot in full
@robot.action("Say")
async def say(what: str) -> None:
    await anyio.sleep(1)
"""
ALL_SAY_NOTHING = ", ".join(
    f"{n}: {{reads: []}}" for n in ("Say", "NavigateTo", "Grasp", "Release")
)
OWN = (
    "Say: {reads: []}, NavigateTo: {effects: {at: true}}, Grasp: {requires: {at: true}, "
    "effects: {full: true}}, Release: {requires: {at: true, full: true}, effects: {full: false}}"
)
APART = ["Say(hello)", "NavigateTo(a)", "Say(there)", "Grasp", "NavigateTo(b)", "Release"]


@pytest.mark.parametrize(
    ("declared", "attribute", "options", "units"),
    [
        ("", "", (), ["Say_to_Release"]),
        ("Say: {reads: []}", "", (), ["Say(hello)", "NavigateTo_to_Release"]),
        (OWN, "", (), ["Say(hello)", "NavigateTo_to_Release"]),
        # Release declares nothing, so it may need what the last drive and the grasp have made.
        (OWN.rpartition(", Release")[0], "", (), ["Say(hello)", "NavigateTo_to_Release"]),
        (ALL_SAY_NOTHING, "", (), APART),
        ("", ' _independent="true"', (), APART),
        ("", ' name="all"', ("--assume-independent", "all"), APART),
        ("", "", ("--assume-independent", "M/Sequence"), APART),
        ("", "", ("--assume-independent", "M/Sequence:1"), APART),
    ],
)
def test_only_what_is_declared_is_cut(
    folder: Path, declared: str, attribute: str, options: tuple[str, ...], units: list[str]
) -> None:
    (folder / "tree.xml").write_text(FETCH.replace("{0}", attribute))
    (folder / "team.yaml").write_text(FETCH_TEAM % declared)
    data = json.loads(done(run(folder, "--json", *options)))
    assert [unit["call"] for unit in data["units"]] == units
    assert len(data["cuts"]) == len(units) - 1
    assert all("declared" in cut["reason"] for cut in data["cuts"])


def test_after_a_death_nobody_grasps_where_it_never_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    (folder / "tree.xml").write_text(FETCH.replace("{0}", ""))
    (folder / "team.yaml").write_text(FETCH_TEAM % "Say: {reads: []}")
    (folder / "robot.py").write_text(FETCH_PROGRAM)
    assert run(folder, "-o", str(folder / "mission.yaml"))[0] == 0
    mission = load_mission(folder / "mission.yaml")
    assert mission.program is not None
    for seed, robot in enumerate(("C1", "C2", "C3")):
        result = simulate(
            mission, load_program(mission.program), seed=seed, schedule=[(3_500_000, Kill(robot))]
        )
        assert result.result == "success"
    (unit,) = told(folder)["units"][1:]
    assert unit["reasons"][0] == (
        "NavigateTo, Grasp, Release declare nothing, so they are taken to depend on one another"
    )
