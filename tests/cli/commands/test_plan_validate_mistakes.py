"""Ways to get a mission, a program or a command wrong: each is a line or two, and nothing runs."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import new_run
from tests.support.command import mrbt

MISSION = """mission: demo
program: robot.py
parameters:
  boxes: [red, green]
local_tasks:
  carry: {parameters: [box], work: 2}
  scan: {}
conditions:
  open: {parameters: [box]}
robot_types:
  porter:
    capabilities: {carry: 1, scan: 1}
robots: {P1: porter, P2: porter}
global_tasks:
  move:
    parameters: [box]
    needs:
      carry($box): {min: 1, max: 1}
  look:
    needs:
      scan: {}
tree:
  Sequence:
    - look
    - Parallel:
        for_each: {box: $boxes}
        do: move($box)
"""
PROGRAM = """from pathlib import Path
from mrbt_mesh import RobotProgram, TaskContext

robot = RobotProgram()


@robot.local_task("carry")
async def carry(task: TaskContext, box: str) -> None:
    Path("carried").touch()


@robot.local_task("scan")
async def scan(task: TaskContext) -> None:
    Path("scanned").touch()
"""
TREE = MISSION.index("tree:")
Files = dict[str, str | bytes]
# (files besides or in place of the right ones, arguments, what is said first)
Mistake = tuple[Files, str, str]


def written(old: str, new: str, said: str, arguments: str = "validate mission.yaml") -> Mistake:
    """A change of the mission."""
    assert old in MISSION
    return {"mission.yaml": MISSION.replace(old, new)}, arguments, f"mission.yaml:{said}"


def told(mistake: Mistake, said: str) -> Mistake:
    """The same mistake, told of another place than the mission."""
    return *mistake[:2], said


def coded(old: str, new: str, said: str, arguments: str = "validate mission.yaml") -> Mistake:
    """A change of the program."""
    assert old in PROGRAM
    return {"robot.py": PROGRAM.replace(old, new)}, arguments, f"robot.py{said}"


def bound(kind: str, name: str, text: str, said: str) -> Mistake:
    """A program of a file with bindings."""
    program = f"""from pathlib import Path
from mrbt_mesh.adapters.{kind} import robot_program
robot = robot_program(Path(__file__).with_name({name!r}))
"""
    return {"robot.py": program, name: text}, "validate mission.yaml", f"{name}:{said}"


def ros(text: str, said: str) -> Mistake:
    """Bindings to ROS 2."""
    return bound("ros2", "ros2.yaml", text, said)


def whole(content: str | bytes, said: str) -> Mistake:
    """Another content of the mission."""
    return {"mission.yaml": content}, "validate mission.yaml", f"mission.yaml{said}"


def given(arguments: str, said: str, **files: str) -> Mistake:
    """Right files, and a wrong command."""
    return {name.replace("_", "."): text for name, text in files.items()}, arguments, said


ACTION = "{action: /x, type: a/action/B, goal: {}, parameters: [%s]}"
FILES = [
    given("validate none.yaml", "none.yaml: there is no such file"),
    given("validate folder.yaml", "folder.yaml: not a file; give the file itself"),
    given("validate robot.py", "robot.py: a mission file ends in .yaml, .yml or .json"),
    given("validate unreadable.yaml", "unreadable.yaml: cannot be read: "),
    given("validate m.json", "m.json:1: not valid JSON", m_json='{"a": 1'),
    given("validate m.json", "m.json: not a compiled mission", m_json='{"a": 1}'),
    whole("", ": the file is empty"),
    whole(b"mission: demo\nname: \xff\xfe\n", ":2: not a text file in UTF-8"),
    whole(MISSION.encode("utf-16"), ":1: not a text file in UTF-8"),
    whole(MISSION + "\0", ":28: not valid YAML: the control character U+0000 is not allowed"),
    whole("- a\n", ":1: a mission is expected (mission: ..., robots: ...), found a list"),
]
SYNTAX = [
    written("  carry: {", "\tcarry: {", "6: not valid YAML: this line is indented with a tab; use"),
    written("      scan:", "    \tscan:", "21: not valid YAML: this line is indented with a tab"),
    written(
        "  scan: {}\nc", " scan: {}\nc", "7: not valid YAML: this line begins in column 2, line"
    ),
    written(
        "    - look", "   - look", "25: not valid YAML: this line is indented as a part of line"
    ),
    written("2: porter}", "2: porter", "13: not valid YAML: the { that opens here is not closed;"),
    written("green]", "green", "4: not valid YAML: the [ that opens here is not closed; add ]"),
    written("2: porter}", "2: porter}}", "13: not valid YAML: this } closes nothing; remove it"),
    written("r, P2", "r P2", "13: not valid YAML: a comma, or the closing }, is missing in this"),
    written(": demo", ': "demo', "1: not valid YAML: the quote that opens here is never closed;"),
    written(": demo", ": 'demo' 2", "1: not valid YAML: text follows a quoted text; put all of it"),
    written(": demo", ":demo", "1: not valid YAML: a space is missing after the colon"),
    written("mission: demo", "mission demo", "1: not valid YAML: a colon is missing after the key"),
    written("types:\n", "types\n", "10: not valid YAML: a colon is missing after this key"),
    written(": demo", ": demo: 2", "1: not valid YAML: there is a second colon in this line; text"),
    written(": demo", ": @demo", "1: not valid YAML: text that begins with @ needs quotes"),
    written(
        ": demo", ": *demo", "1: not valid YAML: found undefined alias 'demo'; text that begins"
    ),
    written(
        "tree:", "---\ntree:", "22: not valid YAML: a second document begins here (---); a file"
    ),
    written("tree:", "robots: {}\ntree:", "22: robots: 'robots' is given twice, first on line 13;"),
    written("P2: porter", "P1: porter", "13: robots/P1: 'P1' is given twice, first on line 13"),
    written("  scan: {}\nc", "  scan: {}\n  <<: {}\nc", "8: local_tasks: merge keys (<<) are not"),
]
# One of each kind: tests/formats/test_mission_file_errors.py has all.
WORDS = [
    written(
        "work: 2", "wrok: 2", "6: local_tasks/carry/wrok: unknown key 'wrok'; did you mean 'work'"
    ),
    written(MISSION[TREE:], "", "1: the key 'tree' is missing"),
    written(
        "n: 1, m", "n: 2, m", "18: global_tasks/move/needs/carry($box): min (nu) is 2, but max"
    ),
    written(
        " $boxes", " $boxs", "26: tree/Sequence[2]/Parallel/for_each/box: unknown parameter $boxs"
    ),
    written("[red, green]", "[]", "25: tree/Sequence[2]/Parallel: no children: every list that"),
]
# tests/runtime/test_program_loader.py and test_program_function.py have all.
PROGRAMS = [
    told(written("robot.py", "robt.py", ""), "robt.py: there is no such file; the mission's"),
    coded("robot = Ro", "robot = (Ro", ":4: not valid Python: '(' was never closed"),
    coded("TaskContext\n", "TaskContxt\n", ":2: cannot import name 'TaskContxt' from 'mrbt_mesh'"),
    coded("robot = RobotProgram()", "robot = 3", ":7: AttributeError: 'int' object has no"),
    coded(PROGRAM, "\0", ": not valid Python: source code string cannot contain null bytes"),
    coded('"scan"', '"scn"', ": no function for the local task scan; rename 'scn', or add @robot"),
    coded('"scan"', '"carry"', ":12: local task 'carry' is registered twice, first at "),
    coded(
        '@robot.local_task("scan")',
        '@robot.bid("carry")\ndef bid():\n    return 1\n\n\n@robot.local_task("scan")',
        ":12: bid 'carry': the function takes 0 arguments besides the context",
    ),
    coded(
        "box: str", "box: int", ":7: local task 'carry': parameter 'box': the text 'green' is no"
    ),
    told(
        written("max: 1}", "max: 1, performance: bid}", ""),
        'robot.py: no bid for the local task carry; add @robot.bid("carry")',
    ),
    told(written("robot.py", "robot.py\nsolver: cp_satt", ""), "no solver 'cp_satt'; did you mean"),
]
BINDINGS = [
    bound("vda5050", "agvs.yaml", "nodes: {a: [0, 0}\n", "1: not valid YAML: a comma, or the"),
    bound(
        "vda5050",
        "agvs.yaml",
        """map: a
nodes: {a: [0, 0]}
vehicles: {P1: {manufacturer: x}, P2: {manufacturer: x}}
local_tasks: {carry: {stops: [{at: a}]}, scan: {stops: [{at: a}]}}
""",
        "4: local_tasks/carry/parameters: the parameters are [], but the mission declares carry(",
    ),
    ros(
        "local_tasks:\n  carry: {acton: /x}\n", "2: local_tasks/carry/acton: unknown key 'acton'; "
    ),
    ros(
        f"local_tasks:\n  carry: {ACTION % 'a, b'}\n", "2: local_tasks/carry/parameters: the param"
    ),
    ros(
        f"robots: {{P1: {{}}}}\nlocal_tasks: {{carry: {ACTION % 'b'}, scan: {ACTION % ''}}}\n",
        "1: robots: the mission's robot P2 is missing here",
    ),
    ros(
        f"local_tasks:\n  carry: {ACTION[:-1] % 'b'}, sets: {{opn($b): true}}}}\n",
        "2: local_tasks/carry/sets/opn($b): mission demo has no condition 'opn'; did you",
    ),
]
COMMANDS = [
    given("validate mission.yaml --robots P9", "--robots P9: mission demo has no robot 'P9'; "),
    given("validate mission.yaml --program x.py", "x.py: there is no such file"),
    given("validate mission.yaml --compile mission.yaml", "--compile mission.yaml: is the mission"),
    given("sim run mission.yaml --kill P1", "--kill P1: expected ROBOT@SECONDS, e.g. A1@12.5"),
    given("sim run mission.yaml --kill P1@-3", "--kill P1@-3: expected ROBOT@SECONDS"),
    given("sim run mission.yaml --kill P1@nan", "--kill P1@nan: expected ROBOT@SECONDS"),
    given("sim run mission.yaml --kill P1@3,", "--kill P1@3,: expected ROBOT@SECONDS"),
    given(
        "sim run mission.yaml --kill X9@3", "--kill X9@3: mission demo has no robot 'X9'; known: P1"
    ),
    given("sim run mission.yaml --thaw P1@0.1", "--thaw P1@0.1: P1 is not frozen at that time"),
    given(
        "sim run mission.yaml --fault P1:cary@1",
        "--fault P1:cary@1: P1 has no local task 'cary'; d",
    ),
    given(
        "sim run mission.yaml --fault P1:carry(blue)@1", "--fault P1:carry(blue)@1: P1 has no local"
    ),
    given(
        "sim run mission.yaml --performance P1:carry=x@1",
        "--performance P1:carry=x@1: a performance",
    ),
    given(
        "sim run mission.yaml --loss 2",
        "Invalid value for '--loss': 2.0 is not in the range 0<=x<=1",
    ),
    given(
        "sim run mission.yaml --seed -1", "Invalid value for '--seed': -1 is not in the range x>=0"
    ),
    given(
        "sim run mission.yaml --timeout nan",
        "Invalid value for '--timeout': nan: a number of at most",
    ),
    given(
        "sim run mission.yaml --events a --log a", "--log a: is --events as well; name another file"
    ),
    given("sim run mission.yaml --log mission.yaml", "--log mission.yaml: is the mission as well"),
    given("sim run --schedule robot.py", "robot.py: no schedule as `mrbt sim chaos` writes them: "),
    given(
        "plan mission.yaml --alive P1,P9", "--alive P1,P9: mission demo has no robot 'P9'; known"
    ),
    given(
        "plan mission.yaml --facts f.yaml",
        "f.yaml:1: conditons: unknown key 'conditons'; did",
        f_yaml="conditons: {}",
    ),
    given("up mission.yaml --port 70000", "Invalid value for '--port': 70000 is not in the range"),
    given("up mission.yaml --transport wird", "Invalid value for '--transport' (env var: "),
    given(
        "up mission.yaml --router 10.0.0.1", "endpoint '10.0.0.1': the transport wired needs tcp/"
    ),
    given("up mission.yaml --run-dir robot.py", "--run-dir robot.py: is a file; name a folder"),
    given("up mission.yaml --continue --run-dir none", "none holds no run (no run.json)"),
    given("kill P1 --run-dir none", "none holds no run (no run.json)"),
    given("kill P1 --run-dir run", "P1 does not run in run; `mrbt join P1` starts it"),
    given("kill X9 --run-dir run", "the run in run has no robot 'X9'; known: P1, P2"),
    given("recording replay robot.py", "robot.py is not an mrbt recording"),
]
ALL = [*FILES, *SYNTAX, *WORDS, *PROGRAMS, *BINDINGS, *COMMANDS]
# The same mistakes are told by the commands that would run something.
OF_OTHERS = [
    (files, f"{command} mission.yaml", said)
    for command, mistakes in {
        "up": [SYNTAX[0], SYNTAX[5], *WORDS, *PROGRAMS[:9], BINDINGS[1]],
        "sim run": [whole("", ": the file is empty"), SYNTAX[8], WORDS[3], *PROGRAMS[5:9]],
        "plan": [SYNTAX[3], *WORDS[2:]],
        "analyze": [SYNTAX[3], *WORDS[2:]],
        "sim estimate": [SYNTAX[3], PROGRAMS[8]],
    }.items()
    for files, _, said in mistakes
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The right files, and what is not a file that can be read."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "mission.yaml").write_text(MISSION)
    (tmp_path / "robot.py").write_text(PROGRAM)
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "unreadable.yaml").symlink_to("/proc/self/mem")
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("mrbt_program_")]:
        del sys.modules[name]


def test_without_a_mistake_it_is_valid_and_nothing_runs(folder: Path) -> None:
    for text in (MISSION, "\ufeff" + MISSION, MISSION.replace("\n", "\r\n")):
        (folder / "mission.yaml").write_text(text, newline="")
        code, output, problems = mrbt("validate", "mission.yaml")
        assert (code, problems) == (0, "")
        valid, unused = output.splitlines()
        assert valid == "valid demo: 2 robots, 2 local tasks, 3 global tasks, 5 tree nodes"
        assert unused.startswith("warning: line 9: the condition 'open' is declared and nothing")
    assert not list(folder.glob("*ed"))


def test_these_are_many_and_no_two_are_the_same() -> None:
    assert len({(str(files), arguments) for files, arguments, _ in ALL}) == len(ALL) >= 70


@pytest.mark.parametrize(("files", "arguments", "said"), [*ALL, *OF_OTHERS])
def test_a_mistake_is_told_in_a_line_or_two(
    files: Files, arguments: str, said: str, folder: Path
) -> None:
    if "--run-dir run" in arguments:
        mission = load_mission(folder / "mission.yaml")
        info = new_run(
            mission, Path("mission.yaml"), ["P1", "P2"], RobotOptions(program="robot.py")
        )
        RunDir.create(folder / "run", info, compile_mission(mission))
    for name, content in files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    before = set(os.listdir(folder))
    code, output, problems = mrbt(*arguments.split())
    lines = problems.splitlines()
    assert (code, output) == (2, ""), problems
    assert lines[0].removeprefix("error: ").replace(f"{folder}/", "", 1).startswith(said), problems
    assert len(lines) <= 2, problems
    assert "Traceback" not in problems
    assert set(os.listdir(folder)) - before <= {"__pycache__"}, "something has run"
