"""`mrbt tree lift`: what it writes, what it says, and every reason for which it refuses a tree."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.formats.mission_file import load_mission, mission_warnings
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, SimulationResult, simulate
from tests.support.command import done, mrbt, refused
from tests.support.paths import ROOT

S = 1_000_000
MODELS = """<TreeNodesModel>
<Action ID="Go"><input_port name="to"/></Action>
<Action ID="See"><output_port name="what"/></Action>
<Action ID="Take"><input_port name="what"/></Action>
<Condition ID="Ready"/>
</TreeNodesModel>"""


def write(folder: Path, main: str, trees: str = "") -> Path:
    """A file with the tree `Main`, whose root is in line 2."""
    path = folder / "tree.xml"
    path.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">\n'
        f"{main}</BehaviorTree>{trees}{MODELS}</root>"
    )
    return path


def lift(path: Path, *options: str) -> str:
    return done(mrbt("tree", "lift", str(path), str(path.parent / "new"), *options))


def run(path: Path, *kills: tuple[int, str]) -> tuple[SimulationResult, list[str]]:
    """A run of the folder beside the tree, and what was begun in it, with the robot."""
    begun: list[str] = []
    program = RobotProgram()
    program.condition("Ready")(lambda: True)

    @program.action("*")
    async def work(kind: str, /, **ports: Any) -> None:
        begun.append(" ".join([kind, *map(str, ports.values())]))
        await anyio.sleep(1)

    mission = load_mission(path.parent / "new" / "mission.yaml")
    assert mission_warnings(mission) == []
    schedule = [(at, Kill(robot)) for at, robot in kills]
    result = simulate(mission, program, seed=1, schedule=schedule)
    assert result.violations == []
    return result, begun


STEPS = '<Sequence><Go to="a"/><Go to="b"{}/><Go to="c"/><Go to="d"/></Sequence>'


def test_a_tree_without_marks_is_one_task_of_one_robot(tmp_path: Path) -> None:
    path = write(tmp_path, STEPS.format(""))
    said = lift(path, "--robots", "4")
    assert "One task, Main: one robot does all of it, another goes on from the beginning." in said
    mission = load_mission(tmp_path / "new" / "mission.yaml")
    assert [node.subject for node in mission.tree.nodes] == ["Main"]
    assert len(mission.robots) == 4
    result, begun = run(path)
    assert (result.result, begun) == ("success", ["Go a", "Go b", "Go c", "Go d"])


def test_another_robot_begins_anew_or_after_the_last_checkpoint(tmp_path: Path) -> None:
    kill = (5 * S // 2, "R1")  # in `c`
    for mark, again in (("", ["Go a", "Go b"]), (' _checkpoint="true"', [])):
        folder = tmp_path / f"of{len(mark)}"
        folder.mkdir()
        path = write(folder, STEPS.format(mark))
        lift(path)
        result, begun = run(path, kill)
        assert result.result == "success"
        assert begun == ["Go a", "Go b", "Go c", *again, "Go c", "Go d"]


def test_checkpoints_in_subtrees_and_several_of_them(tmp_path: Path) -> None:
    inner = (
        '<BehaviorTree ID="In"><Sequence><Go to="b" _checkpoint="true"/><See what="{x}"/>'
        '<Take what="{x}"/></Sequence></BehaviorTree>'
    )
    main = '<Sequence><Go to="a" _checkpoint="true"/><SubTree ID="In"/><Go to="d"/></Sequence>'
    path = write(tmp_path, main, inner)
    lift(path)
    result, begun = run(path, (3 * S // 2, "R1"), (4 * S + S // 2, "R2"))
    assert result.result == "success"
    # Each takes over where the one before was: `b` anew after `a`, `See` anew after `b`.
    assert begun[:4] == ["Go a", "Go b", "Go b", "See"]
    assert begun.count("Go a") == 1
    assert begun.count("Go b") == 2
    assert begun[-1] == "Go d"


def test_a_checkpoint_of_an_earlier_round_is_none_of_this_one(tmp_path: Path) -> None:
    body = '<Sequence _team="true"><Go to="a" _checkpoint="true"/><Go to="b"/></Sequence>'
    path = write(tmp_path, f'<Repeat num_cycles="2">{body}</Repeat>')
    lift(path)
    result, begun = run(path)
    assert (result.result, begun) == ("success", ["Go a", "Go b"] * 2)


def test_what_is_marked_is_spread_and_nothing_else(tmp_path: Path) -> None:
    inner = (
        '<BehaviorTree ID="Fetch"><Sequence><See what="{x}"/><Take what="{x}"/><Go to="{home}"/>'
        "</Sequence></BehaviorTree>"
    )
    main = (
        '<Sequence><Go to="a"/><Ready/><Go to="b"/><Go to="c" _team="true"/>'
        '<Sequence name="both" _parallel="true"><SubTree ID="Fetch" home="n"/>'
        '<SubTree ID="Fetch" home="s"/></Sequence>'
        '<Fallback><Go to="e"/><Go to="f"/></Fallback></Sequence>'
    )
    path = write(tmp_path, main, inner)
    said = lift(path)
    for line in (
        "  Go_to_Go: Go, Ready, Go (Main/Sequence/Go:2)",
        "  Go(c): Go (Main/Sequence/Go:2)",
        "  Fetch(n): Fetch (Main/Sequence/both/Fetch:2)",
        "  Fetch(s): Fetch (Main/Sequence/both/Fetch:2)",
        "  Go_to_Go_2: Fallback (Main/Sequence/Fallback:2)",
    ):
        assert line in said.splitlines()
    mission = load_mission(tmp_path / "new" / "mission.yaml")
    kinds = [node.kind for node in mission.tree.nodes if node.children]
    assert kinds == [Kind.SEQUENCE, Kind.PARALLEL]
    result, begun = run(path)
    assert result.result == "success"
    assert begun[:3] == ["Go a", "Go b", "Go c"]
    assert sorted(begun[3:5]) == ["See", "See"]
    assert begun[-1] == "Go e"


def test_marks_on_the_command_line_are_those_in_the_file(tmp_path: Path) -> None:
    main = '<Sequence><Go to="a"{}/><Sequence name="two"{}><Go to="b"/><See/></Sequence></Sequence>'
    (tmp_path / "file").mkdir()
    (tmp_path / "words").mkdir()
    path = write(tmp_path / "file", main.format(' _team="true"', ' _parallel="true"'))
    lift(path)
    given = write(tmp_path / "words", main.format("", ""))
    lift(given, "--team", "Sequence/Go", "--parallel", "two")
    texts = [(p.parent / "new" / "mission.yaml").read_text() for p in (path, given)]
    assert texts[0] == texts[1]
    assert json.loads(done(mrbt("tree", "lift", str(given), "--json"))) == {
        "mission": None,
        "tasks": [
            {
                "call": "Main",
                "tree": "Main",
                "nodes": ["Main/Sequence"],
                "line": 2,
                "checkpoints": False,
            }
        ],
    }


def test_every_action_is_the_papers_own_lift(tmp_path: Path) -> None:
    main = '<Sequence><Go to="a"/><Fallback><Ready/><Go to="b"/></Fallback><See/></Sequence>'
    path = write(tmp_path, main)
    lift(path, "--every-action")
    mission = load_mission(tmp_path / "new" / "mission.yaml")
    subjects = [node.subject for node in mission.tree.nodes if node.subject]
    assert subjects == ["Go(a)", "Ready", "Go(b)", "See"]
    assert run(path)[1] == ["Go a", "See"]


def test_a_failure_of_a_robots_tree_is_that_of_the_task(tmp_path: Path) -> None:
    """No other robot tries what the single one would have failed with, also after a death."""
    path = write(tmp_path, '<Sequence><Go to="a"/><Go to="b"/><AlwaysFailure/></Sequence>')
    lift(path)
    result, begun = run(path, (S // 2, "R1"))
    assert result.result == "failure"
    assert begun == ["Go a", "Go a", "Go b"]


def test_a_program_of_ones_own_and_odd_values(tmp_path: Path) -> None:
    """A value that is no argument, one with a `$`, and entries that only the program knows."""
    inner = (
        '<BehaviorTree ID="In"><Sequence _team="true"><Go to="{p}"/><Go to="{q}"/><Go to="{r}"/>'
        "</Sequence></BehaviorTree>"
    )
    main = (
        '<Sequence><Go to="x" _team="true"/><SubTree ID="In" p="1;2" q="{goal}" r="$5"/>'
        '<SubTree ID="In" p="3.50" q="{goal}" r="{goal}"/></Sequence>'
    )
    path = write(tmp_path, main, inner)
    (tmp_path / "own.py").write_text(
        "from mrbt_mesh import RobotProgram\nrobot = RobotProgram()\nwent = []\n"
        "robot.entry('goal')(lambda: 'there')\n"
        "@robot.action('Go')\nasync def go(to: str) -> None:\n    went.append(to)\n"
    )
    said = lift(path, "--program", str(tmp_path / "own.py"))
    assert "robot.py" not in said
    mission = load_mission(tmp_path / "new" / "mission.yaml")
    assert mission.program is not None
    assert simulate(mission, load_program(mission.program), seed=1).result == "success"
    (module,) = [m for m in list(sys.modules.values()) if getattr(m, "went", None)]
    assert module.went == ["x", "1;2", "there", "$5", "3.500000", "there", "there"]


REFUSALS = {
    "an entry between tasks": (
        '<Sequence><See what="{x}" _team="true"/><Take what="{x}"/></Sequence>',
        "Main/Sequence/Take: it reads {x}: Main/Sequence/See (line 2) writes it, which another "
        "robot may do; leave both in one task",
    ),
    "an entry of an earlier round": (
        '<Repeat num_cycles="2"><Sequence><Fallback _team="true"><Take what="{x}"/>'
        '<See what="{x}"/></Fallback></Sequence></Repeat>',
        "it reads {x}: the loop above begins this task with an empty blackboard",
    ),
    "an unknown entry": (
        '<Sequence><SetBlackboard value="1" output_key="{k}"/><Go to="b" _team="true"/></Sequence>',
        "it writes an entry that is only known when it runs",
    ),
    "a reactive node": (
        '<ReactiveSequence><Ready/><Go to="a" _team="true"/></ReactiveSequence>',
        "a team does it once; Main/ReactiveSequence/Go, below it, is marked as the team's",
    ),
    "a precondition above": (
        '<Sequence _skipIf="k == 1"><Go to="a" _team="true"/></Sequence>',
        "_skipIf is not asked at every tick, or skips the node; use a Condition; Main/Sequence/Go",
    ),
    "a decorator above": (
        '<Delay delay_msec="5"><Go to="a" _team="true"/></Delay>',
        "Delay: it waits, which only an action can do in a team's tree; Main/Delay/Go, below it",
    ),
    "a control above": (
        '<Switch2 variable="{v}" case_1="1" case_2="2"><Go to="a" _team="true"/><Go to="b"/>'
        '<Go to="c"/></Switch2>',
        "it chooses by a value on the blackboard, which a team does not share",
    ),
    "a port above": (
        '<Repeat num_cycles="{n}"><Go to="a" _team="true"/></Repeat>',
        "port 'num_cycles' uses the blackboard entry 'n', which a team does not share",
    ),
    "a node of its own above": (
        '<Sometimes><Go to="a" _team="true"/></Sometimes>',
        "an unknown Decorator; its effect is not known",
    ),
    "a control that watches its condition above": (
        '<WhileDoElse><Ready/><Go to="a" _team="true"/><Go to="b"/></WhileDoElse>',
        "it asks its condition again at each tick, and a task of the team is done once",
    ),
    "a loop that is skipped": (
        '<Fallback><LoopString queue="" if_empty="SKIPPED" value="{w}" _team="true"><Go to="{w}"/>'
        '</LoopString><Go to="b"/></Fallback>',
        "it may be skipped, which a task of the team cannot be here",
    ),
    "a loop whose end an entry decides": (
        '<Fallback><LoopInt queue="" if_empty="{e}" value="{w}" _team="true"><Go to="{w}"/>'
        '</LoopInt><Go to="b"/></Fallback>',
        "it may be skipped, which a task of the team cannot be here",
    ),
    "a task that is skipped": (
        '<Fallback><Go to="a" _skipIf="k == 1" _team="true"/><Go to="b"/></Fallback>',
        "it may be skipped, which a task of the team cannot be here",
    ),
    "a node that remembers": (
        '<Repeat num_cycles="2"><Sequence><SequenceWithMemory><Go to="a"/></SequenceWithMemory>'
        '<Go to="b" _team="true"/></Sequence></Repeat>',
        "SequenceWithMemory remembers earlier rounds of the loop above, which other robots may",
    ),
    "a condition": (
        '<Sequence><Ready _team="true"/><Go to="a"/></Sequence>',
        "_team: a condition is not a task; mark the node above it",
    ),
    "no Sequence": (
        '<IfThenElse _parallel="true"><Ready/><Go to="a"/></IfThenElse>',
        "_parallel: only a Sequence or a Fallback, not IfThenElse",
    ),
    "no truth": (
        '<Sequence><Go to="a" _team="maybe"/></Sequence>',
        "_team='maybe' is neither true nor false",
    ),
    "a checkpoint that is not reached in order": (
        '<Fallback><Go to="a" _checkpoint="true"/><Go to="b"/></Fallback>',
        "_checkpoint: is below Main/Fallback; only Sequences and SubTrees may be above",
    ),
    "a checkpoint below a condition": (
        '<Sequence _skipIf="k == 1"><Go to="a" _checkpoint="true"/></Sequence>',
        "_checkpoint: is below Main/Sequence, which has _skipIf",
    ),
    "a checkpoint that loses an entry": (
        '<Sequence><See what="{x}"/><Go to="a" _checkpoint="true"/><Take what="{x}"/></Sequence>',
        "_checkpoint: Main/Sequence/Take reads {x}, which was written before it",
    ),
    "a checkpoint in two places": (
        '<Sequence _parallel="true"><SubTree ID="In"/><SubTree ID="In"/></Sequence>',
        "In is begun in two places, and its checkpoints would be those of both",
    ),
    "a SubTree that is nowhere": (
        '<Sequence><SubTree ID="Gone"/></Sequence>',
        "there is no tree 'Gone'; name its file (--models) or its folder (--trees)",
    ),
}
IN = (
    '<BehaviorTree ID="In"><Sequence><Go to="a" _checkpoint="true"/><Go to="b"/></Sequence>'
    "</BehaviorTree>"
)


@pytest.mark.parametrize(("main", "reason"), REFUSALS.values(), ids=list(REFUSALS))
def test_what_a_mark_would_break_is_refused(tmp_path: Path, main: str, reason: str) -> None:
    path = write(tmp_path, main, IN)
    problems = refused(mrbt("tree", "lift", str(path), str(tmp_path / "new")))
    assert reason in problems
    assert f"{path}:2: Main/" in problems, "the node and its place"
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--team", "Gone"], "--team Gone: there is no such node"),
        (["--team", "Seqence"], "did you mean 'Sequence'"),
        (["--parallel", "Sequence/Go"], "_parallel: only a Sequence or a Fallback, not Go"),
        (["--tree", "Other"], "there is no tree 'Other'"),
        (["--as-action", "Go"], "--as-action: no SubTree node has the ID 'Go'"),
        (["--trees", "nowhere"], "--trees nowhere: there is no such folder"),
        (["--program", "robot"], "--program robot: a Python file is expected"),
        (["--program", "gone.py"], "--program gone.py: there is no such file"),
        (["--program", "gone.py:robot"], "--program gone.py:robot: there is no such file"),
    ],
)
def test_wrong_options_are_refused(tmp_path: Path, options: list[str], reason: str) -> None:
    path = write(tmp_path, STEPS.format(""))
    assert reason in refused(mrbt("tree", "lift", str(path), str(tmp_path / "new"), *options))


def test_a_folder_that_is_there_is_kept(tmp_path: Path) -> None:
    path = write(tmp_path, STEPS.format(""))
    lift(path)
    words = ("tree", "lift", str(path), str(tmp_path / "new"))
    assert "is not empty; name a new folder" in refused(mrbt(*words))
    assert "--program" in refused(mrbt("tree", "lift", str(path), "--program", "robot.py"))


def test_the_example_is_what_the_command_writes(tmp_path: Path) -> None:
    folder = ROOT / "examples" / "lift"
    words = ("--robots", "6", "--program", str(folder / "robot.py"))
    done(mrbt("tree", "lift", str(folder / "repair.xml"), str(tmp_path / "new"), *words))
    assert (tmp_path / "new" / "trees.xml").read_text() == (folder / "trees.xml").read_text()
    new, shipped = (load_mission(at / "mission.yaml") for at in (tmp_path / "new", folder))
    assert new.tree == shipped.tree
    assert new.global_tasks == shipped.global_tasks
    assert new.robots == shipped.robots
