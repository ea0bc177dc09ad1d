"""The program that `mrbt tree lift` writes: to be filled in, and runs at once."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import check_program, load_program
from mrbt_mesh.sim import simulate
from tests.support.command import done, mrbt, refused
from tests.support.paths import ROOT

pytestmark = pytest.mark.filterwarnings("ignore:.*is not filled in")
TREES = sorted((ROOT / "examples" / "robot_trees").glob("*/*.xml"))


@pytest.fixture(autouse=True)
def _path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))


def new(folder: Path, file: Path, *more: str) -> tuple[int, str, str]:
    return mrbt("tree", "lift", str(file), str(folder), *more)


def written(folder: Path, tree: str, *more: str, name: str = "task") -> str:
    """The program of a new team for this tree, in the folder `mine`; it is run, and succeeds."""
    (folder / f"{name}.xml").write_text(tree)
    done(new(folder / "mine", folder / f"{name}.xml", *more))
    runs(folder / "mine")
    return (folder / "mine" / "robot.py").read_text()


def runs(folder: Path) -> None:
    """A team in a folder carries its mission out."""
    mission = load_mission(folder / "mission.yaml")
    assert mission.program is not None
    assert simulate(mission, load_program(mission.program), seed=1).result == "success"


@pytest.mark.parametrize("tree", TREES, ids=lambda t: t.stem)
def test_a_tree_of_ones_own_becomes_a_team_with_functions_to_fill_in(
    tree: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "mine"
    assert f"now: mrbt up {folder / 'mission.yaml'}" in done(new(folder, tree))
    assert {path.name for path in folder.iterdir()} == {
        "mission.yaml",
        "trees.xml",
        "robot.py",
        "test_mission.py",
    }
    ast.parse((folder / "test_mission.py").read_text())
    mission = load_mission(folder / "mission.yaml")
    assert mission.program == str((folder / "robot.py").resolve())
    program = load_program(mission.program)
    for robot in mission.robots.values():
        assert check_program(program, mission, robot.capabilities) == []


MODELS = """<root BTCPP_format="4" main_tree_to_execute="M">
<BehaviorTree ID="M"><Sequence>
  <Ready/><Look-At at="{p}" n="{n}"/><Go to="{p}" lambda="3"/><ScriptCondition code="n == 1"/>
</Sequence></BehaviorTree>
<TreeNodesModel>
  <Condition ID="Ready"/>
  <Action ID="Look-At"><output_port name="at"/><output_port name="n" type="int"/></Action>
  <Action ID="Go"><input_port name="to"/><input_port name="lambda"/></Action>
</TreeNodesModel></root>"""


@pytest.mark.slow
def test_functions_write_the_ports_that_models_describe(tmp_path: Path) -> None:
    text = written(tmp_path, MODELS)
    assert '@robot.condition("Ready")\ndef ready() -> bool:' in text
    assert "async def look_at(at: Out[str], n: Out[int]) -> None:" in text
    assert "async def go(**ports: object) -> None:" in text
    folder = tmp_path / "mine"
    code, output = run_pytest(folder)
    assert code == 0, output
    assert "Ready is not filled in and answers True" in output
    program = folder / "robot.py"
    program.write_text(text.replace("return True", "return False"))
    code, output = run_pytest(folder)
    assert code == 1, "a mission that fails"
    assert "2 failed" in output


def run_pytest(folder: Path) -> tuple[int, str]:
    plugins = ("-p", "mrbt_mesh.pytest_plugin", "-p", "no:cacheprovider", "-p", "no:asyncio")
    words = [sys.executable, "-m", "pytest", "-q", *plugins, "test_mission.py"]
    run = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    return run.returncode, run.stdout


GUARDED = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <ReactiveSequence><Look at="{at}" far="{far}"/><Go to="{at}"/></ReactiveSequence>
  <Look at="{there}" far="" zoom="2"/><Seen at="{seen}"/><Go to="{seen}"/>
  <Heard what="{what}"><Go to="{what}"/></Heard>
</Sequence></BehaviorTree><TreeNodesModel>
  <Decorator ID="Heard"><output_port name="what"/></Decorator>
  <Condition ID="Seen"><output_port name="at"/></Condition>
  <Action ID="Look"><output_port name="at"/><output_port name="far"/>
  <output_port name="colour"/><inout_port name="zoom" default="1"/></Action>
  </TreeNodesModel></root>"""


def test_what_is_written_runs_at_once_whatever_the_tree_repeats_or_leaves_out(
    tmp_path: Path,
) -> None:
    """Two actions in a row in a ReactiveSequence would begin anew for ever."""
    text = written(tmp_path, GUARDED)
    look = "def look(at: Out[str], zoom: str, far: Out[str] | None = None) -> None:"
    assert f"\n{look}" in text
    assert "async def go(to: InOut[str]) -> None:" in text
    assert "colour" not in text
    assert 'self.output("what", "...")' in text


ASKS = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <ScriptCondition code="charge > LOW &amp;&amp; mode == 'auto'"/>
  <Repeat num_cycles="{rounds}"><DistanceController distance="0"><Go to="{place}"/>
  </DistanceController></Repeat>
  <SubTree ID="In"/><Say text="{word}"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="In"><Sequence><Decide what="{what}"/><ScriptCondition code="what == 'stop'"/>
  <ScriptCondition code="STATE_OK == 1 || true"/></Sequence></BehaviorTree>
<TreeNodesModel><Action ID="Say"><input_port name="text" type="std::string"/></Action>
</TreeNodesModel></root>"""


def test_what_a_tree_only_reads_is_asked_of_the_program(tmp_path: Path) -> None:
    text = written(tmp_path, ASKS)
    for line in (
        'robot.enum("LOW", 0)\nrobot.enum("STATE_OK", 1)\n',
        '@robot.entry("charge")\ndef charge() -> float:\n    return 1.0 ',
        '@robot.entry("mode")\ndef mode() -> str:\n    return "auto" ',
        '@robot.entry("rounds")\ndef rounds() -> int:\n    return 1 ',
        '@robot.entry("word")\ndef word() -> str:\n    return "..." ',
        '@robot.source("robot_pose")\n',
        '    what.set("stop")\n',
    ):
        assert line in text
    assert text.count("@robot.entry") == 4


OF_ONES_OWN = """<root BTCPP_format="4"><BehaviorTree ID="Other"><Go/></BehaviorTree>
<BehaviorTree ID="Main Tree"><Sequence>
  <WhenCalm limit="2" wind="{wind}"><Go to="dock" error="{error}"/></WhenCalm>
  <Both-Of><Go to="shelf"/><GoalUpdated/></Both-Of>
  <SubTree ID="Fetch It" what="cup" _autoremap="true"/>
</Sequence></BehaviorTree></root>"""
FETCH = """<root BTCPP_format="4"><BehaviorTree ID="Fetch It">
<Sequence><Grasp what="{what}"/><SubTree ID="Home"/></Sequence></BehaviorTree>
<TreeNodesModel><Action ID="Grasp"><input_port name="what" type="std::string"/></Action>
</TreeNodesModel></root>"""
HOME = '<root BTCPP_format="4"><BehaviorTree ID="Home"><Go to="home"/></BehaviorTree></root>'


def test_nodes_of_ones_own_and_trees_of_other_files(tmp_path: Path) -> None:
    (tmp_path / "task.xml").write_text(OF_ONES_OWN)
    (tmp_path / "trees").mkdir()
    (tmp_path / "trees" / "fetch.xml").write_text(FETCH)
    (tmp_path / "trees" / "unused.xml").write_text(HOME.replace("Home", "Unused"))
    (tmp_path / "home.xml").write_text(HOME)
    file = tmp_path / "task.xml"
    others = ("--trees", str(tmp_path / "trees"), "--models", str(tmp_path / "home.xml"))
    problems = refused(new(tmp_path / "mine", file, "--tree", "Main Tree"))
    assert f"{file}:5: Main Tree/Sequence/Fetch It: there is no tree" in problems.replace("\n", "")
    text = written(tmp_path, OF_ONES_OWN, "--tree", "Main Tree", *others)
    assert '@robot.node("WhenCalm")\nclass WhenCalm(TreeNode):' in text
    assert 'self.input("limit"), self.input("wind")' in text
    assert '@robot.node("Both-Of")\nclass Both_Of(TreeNode):' in text
    assert '@robot.condition("GoalUpdated")' in text, "known without a model"
    assert "async def go(to: str, error: InOut[str] | None = None)" in text
    assert "def grasp(what: str)" in text
    assert "Unused" not in (tmp_path / "mine" / "trees.xml").read_text()


ODD = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>
  <Action ID="robot"/><Action ID="anyio"/><Action ID="str"/><Action ID="warnings"/><SetGoal/>
  <setGoal/><Action ID="set_goal"/><Action ID="2nd/Try"/><Action ID="class" anyio="1"/>
  <Say what="a constant where it writes"/><Tell what="{word}"/><Condition ID="Out"/>
  <SetBlackboard value="{word}" output_key="anyio"/><Go to="{anyio}" via="b"/>
  <Go to="Ä" via="a 'quoted', very long: text: text: text: text: text: text: text: text: text"/>
</Sequence></BehaviorTree><TreeNodesModel>
  <Action ID="Say"><output_port name="what"/></Action>
  <Action ID="Tell"><output_port name="what"/></Action></TreeNodesModel></root>"""


def test_names_and_ports_as_odd_as_files_have_them(tmp_path: Path) -> None:
    """Functions are not called as what the program uses, nor two of them alike."""
    text = written(tmp_path, ODD)
    functions = [n.name for n in ast.parse(text).body if isinstance(n, ast.AsyncFunctionDef)]
    assert functions[:4] == ["do_robot", "do_anyio", "do_str", "do_warnings"]
    assert functions[4:9] == ["set_goal", "set_goal_2", "set_goal_3", "do_2nd_try", "do_class"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<root>", "not well-formed"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><Go/></BehaviorTree>'
         '<BehaviorTree ID="B"><Go/></BehaviorTree></root>', "no tree is named as the main one"),
        ('<root BTCPP_format="4"><BehaviorTree ID="A"><SubTree ID="Gone"/></BehaviorTree></root>',
         "there is no tree 'Gone'; name its file"),
    ],
)  # fmt: skip
def test_a_tree_that_cannot_be_used_is_told(tmp_path: Path, text: str, message: str) -> None:
    tree = tmp_path / "tree.xml"
    tree.write_text(text)
    problems = refused(new(tmp_path / "mine", tree))
    assert message in problems.replace("\n", " ")
    assert not (tmp_path / "mine").exists()


ELSEWHERE = """<root BTCPP_format="4"><include path="gone.xml"/><BehaviorTree ID="Main">
<Sequence><SubTree ID="Move to Waypoint" waypoint="Home" _autoremap="true"/>
<SubTree ID="Open Gripper"/></Sequence></BehaviorTree><TreeNodesModel>
<SubTree ID="Move to Waypoint"><input_port name="waypoint" type="std::string"/></SubTree>
</TreeNodesModel></root>"""


@pytest.mark.parametrize("each", ["*", "Move to Waypoint"])
def test_a_subtree_that_is_in_no_file_may_be_an_action(tmp_path: Path, each: str) -> None:
    """As the objectives that MoveIt Pro brings along: the program has them carried out."""
    tree, folder = tmp_path / "tree.xml", tmp_path / "mine"
    tree.write_text(ELSEWHERE)
    assert "(--as-action 'Move to Waypoint')" in refused(new(folder, tree)).replace("\n", " ")
    for name, said in (("Open Griper", "did you mean 'Open Gripper'"), ("Main", "there is a tree")):
        assert said in refused(new(folder, tree, "--as-action", name))
    done(new(folder, tree, "--as-action", each, "--as-action", "Open Gripper"))
    text = (folder / "robot.py").read_text()
    assert "async def move_to_waypoint(waypoint: str) -> None:" in text
    runs(folder)


FOLLOW = """<root main_tree_to_execute="MainTree"><BehaviorTree ID="MainTree"><Sequence>
<GoalUpdater input_goal="{goal}" output_goal="{updated_goal}">
<ComputePathToPose goal="{updated_goal}" path="{path}"/></GoalUpdater></Sequence>
</BehaviorTree></root>"""


def test_a_file_of_nav2_with_a_long_name(tmp_path: Path) -> None:
    """The mission has the folder's name."""
    text = written(tmp_path, FOLLOW, name=f"follow_{'point_' * 12}größer")
    assert "async def compute_path_to_pose(goal: InOut[str], path: InOut[str]) -> None:" in text
    assert load_mission(tmp_path / "mine" / "mission.yaml").name == "mine"
