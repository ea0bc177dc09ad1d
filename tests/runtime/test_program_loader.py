"""Loading users' robot programs: what works, and what each mistake says."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import dedent

import pytest

from mrbt_mesh import ProgramError, RobotProgram
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import check_program, load_program, require_program
from tests.support.paths import ROOT, mission_file

START = "from mrbt_mesh import RobotProgram\n"


@pytest.fixture(autouse=True)
def _clean_imports(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(sys, "path", list(sys.path))
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]


def write(folder: Path, text: str, name: str = "robot.py") -> str:
    (folder / name).write_text(dedent(text))
    return str(folder / name)


def test_the_default_name_is_robot(tmp_path: Path) -> None:
    file = write(tmp_path, START + "robot = RobotProgram()\nother = RobotProgram()\n")
    assert isinstance(load_program(file), RobotProgram)
    assert load_program(file) is not load_program(file + ":other")


def test_neighbours_can_be_imported_at_once_and_later(tmp_path: Path) -> None:
    write(tmp_path, "VALUE = 3\n", "neighbour_a.py")
    write(tmp_path, "VALUE = 4\n", "neighbour_b.py")
    code = """
        from mrbt_mesh import RobotProgram
        from neighbour_a import VALUE

        robot = RobotProgram()
        robot.first = VALUE

        def later():
            from neighbour_b import VALUE
            return VALUE

        robot.later = later
    """
    program = load_program(write(tmp_path, code))
    assert vars(program)["first"] == 3
    assert vars(program)["later"]() == 4


def test_two_files_of_the_same_name_stay_apart(tmp_path: Path) -> None:
    programs = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        text = START + f"robot = RobotProgram()\nrobot.mark = {name!r}\n"
        programs.append(load_program(write(tmp_path / name, text)))
    assert [vars(program)["mark"] for program in programs] == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n", "robot.py: has no 'robot'; write `robot = RobotProgram()` in it"),
        (START + "robt = RobotProgram()\n", "has no 'robot'; it defines robt; write robot.py:robt"),
        ("robot = 3\n", "'robot' is a int, a RobotProgram is expected"),
        ("x = 1\nrobot = (\n", "robot.py:2: not valid Python: '(' was never closed"),
        ("x = 1\n\nx / 0\n", "robot.py:3: ZeroDivisionError: division by zero"),
        ("def f():\n    raise OSError('no arm')\n\nf()\n", "robot.py:2: OSError: no arm"),
        (
            "import no_such_module_here\n",
            "robot.py:1: No module named 'no_such_module_here'; install it, or correct the import",
        ),
        ("import json\n\njson.loads('x')\n", "robot.py:3: JSONDecodeError"),
        ("import sys\nsys.exit(3)\n", "robot.py:2: calls sys.exit() while it is imported"),
        (
            START + "robot = RobotProgram()\n@robot.local_task('x')\ndef x(): ...\n",
            "robot.py:3: local task 'x': the function is not async; write `async def x(...)`",
        ),
    ],
)
def test_mistakes_in_the_file(tmp_path: Path, text: str, message: str) -> None:
    file = write(tmp_path, text)
    with pytest.raises(ProgramError) as caught:
        load_program(file)
    assert message in str(caught.value)
    assert file in str(caught.value)


def test_a_file_that_failed_is_imported_anew_once_it_is_mended(tmp_path: Path) -> None:
    file = write(tmp_path, "oops\n")
    before = set(sys.modules)
    with pytest.raises(ProgramError, match="NameError"):
        load_program(file)
    assert set(sys.modules) == before
    assert isinstance(load_program(write(tmp_path, START + "robot = RobotProgram()")), RobotProgram)


def test_files_that_cannot_be_programs(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"robot\.py: there is no such file"):
        load_program(str(tmp_path / "robot.py"))
    (tmp_path / "folder.py").mkdir()
    with pytest.raises(ProgramError, match="not a file"):
        load_program(str(tmp_path / "folder.py"))
    with pytest.raises(ProgramError, match=r"expected a Python file, e\.g\. robot\.py"):
        load_program("robot.txt")
    with pytest.raises(ProgramError, match="expected a Python file"):
        load_program("robot.py:not a name")
    (tmp_path / "binary.py").write_bytes(b"\xff\0\xfe")
    with pytest.raises(ProgramError, match=r"binary\.py"):
        load_program(str(tmp_path / "binary.py"))


@pytest.mark.parametrize(
    "name",
    [
        "vehicle_repair",
        "explore",
        "tool_search",
        "couriers",
        "depot",
        "deliveries",
        "assembly",
        "inspection",
    ],
)
def test_the_examples_robots_can_do_what_they_claim(name: str) -> None:
    mission = load_mission(ROOT / "examples" / name / "mission.yaml")
    assert mission.program is not None
    program = load_program(mission.program)
    for capabilities in mission.robot_types.values():
        assert check_program(program, mission, capabilities) == []


def test_missing_local_tasks_are_listed_by_type() -> None:
    mission = load_mission(mission_file("vehicle_repair"))
    program = load_program(str(ROOT / "agents" / "explore.py"))
    lacking = check_program(program, mission, ["replace_hw(2)", "move_frame", "replace_hw"])
    assert lacking == [
        f'no function for the local task {name}; add @robot.local_task("{name}")'
        for name in ("move_frame", "replace_hw")
    ]


def test_a_program_for_everything_lacks_nothing() -> None:
    mission = load_mission(mission_file("vehicle_repair"))
    program = RobotProgram()

    @program.local_task("*")
    async def anything(*_: object) -> None: ...

    assert check_program(program, mission, mission.local_tasks) == []


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("async def f(): ...", "takes 0 arguments besides the context, but the mission declares"),
        ("async def f(a, b): ...", "takes 2 arguments besides the context, but the mission"),
        ("async def f(a, b, *c): ...", "takes at least 2 arguments besides the context"),
        ("async def f(area: int): ...", "parameter 'area': the text 'A' is not an integer, in"),
        (
            "async def f(*areas: float): ...",
            "parameter 'areas': the text 'A' is not a real number",
        ),
        ("async def f(area: 'str', more: int = 3): ...", ""),
        ("async def f(*everything): ...", ""),
        ("class F:\n    async def run(self, a: bool): ...", "neither true nor false"),
        ("class F:\n    async def run(self, a: str): ...", ""),
    ],
)
def test_functions_that_do_not_take_what_the_mission_gives(
    tmp_path: Path, code: str, problem: str
) -> None:
    """Each with its place, before anything runs."""
    text = f"{START}robot = RobotProgram()\n\n@robot.local_task('explore')\n{code}\n"
    program = load_program(write(tmp_path, text))
    found = check_program(program, load_mission(mission_file("explore")), ["explore"])
    line = 6 if "class" in code else 4
    assert len(found) == bool(problem)
    for each in found:
        assert each.startswith(f"{tmp_path}/robot.py:{line}: local task 'explore': ")
        assert problem in each


@pytest.mark.parametrize(
    ("signature", "problem"),
    [
        ("place: str, boxes: int", ""),
        ("place: str", "takes 1 argument besides the context, but the mission declares"),
        ("place: str, boxes: bool", "parameter 'boxes': the text '4' is neither true nor false"),
    ],
)
def test_functions_take_what_jobs_give_them(tmp_path: Path, signature: str, problem: str) -> None:
    text = (
        f"{START}robot = RobotProgram()\n@robot.local_task('take')\nasync def f({signature}): ...\n"
    )
    program = load_program(write(tmp_path, text))
    found = check_program(program, load_mission(mission_file("deliveries")), ["take"])
    assert len(found) == bool(problem)
    assert all(problem in each for each in found)


def test_a_name_that_is_nearly_right_is_named(tmp_path: Path) -> None:
    text = f"{START}robot = RobotProgram()\n@robot.local_task('explroe')\nasync def f(): ...\n"
    program, mission = load_program(write(tmp_path, text)), load_mission(mission_file("explore"))
    message = r"robot\.py: no function for the local task explore; rename 'explroe', or add @robot"
    with pytest.raises(ProgramError, match=message + r".* \(robots: R1, R2\)"):
        require_program(program, "robot.py:robot", mission, {"R1": ["explore"], "R2": ["explore"]})


@pytest.mark.parametrize(
    ("kind", "entry", "problem"),
    [
        ("int", "{min: 1, max: 9}", ""),
        ("float", "{min: 1, max: 9, decimals: 1}", ""),
        ("int", "{min: 1, max: 9, decimals: 1}", "'1.0' .* in fetch\\(\\$found\\) of the mission"),
        ("int", "{values: [1, 2, red]}", "'red' .* in fetch\\(\\$found\\) of the mission"),
        ("int", "{text: 9}", "in fetch\\(\\$found\\) of the mission"),
        ("str", "{text: 9}", ""),
    ],
)
def test_arguments_from_the_blackboard_fit_the_function_with_every_value(
    tmp_path: Path, kind: str, entry: str, problem: str
) -> None:
    text = f"""
        mission: m
        local_tasks: {{look: {{sets: [found]}}, fetch: {{parameters: [what]}}}}
        blackboard: {{found: {entry}}}
        robot_types: {{T: {{capabilities: {{fetch: 1}}}}}}
        robots: {{R1: T}}
        global_tasks: {{get: {{parameters: [what], needs: {{fetch($what): {{}}}}}}}}
        tree: get($found)
    """
    mission = load_mission(Path(write(tmp_path, text, "m.yaml")))
    code = f"""
        from mrbt_mesh import RobotProgram, TaskContext
        robot = RobotProgram()

        @robot.local_task
        async def fetch(task: TaskContext, what: {kind}) -> None: ...
    """
    found = check_program(load_program(write(tmp_path, code)), mission, ["fetch"])
    assert bool(found) is bool(problem), found
    assert not problem or re.search(problem, found[0]), found
