"""Functions of programs: what may be registered, and what their arguments become."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Optional

import pytest
from mypy import api

from mrbt_mesh import ProgramError, RobotContext, RobotProgram, TaskContext
from mrbt_mesh.runtime.program import functions_of
from mrbt_mesh.runtime.user_code import UserCodeError
from tests.support.fake_port import FakePort, context, run
from tests.support.paths import ROOT


async def by_name(task: TaskContext, *, speed: float) -> None: ...
async def of_path(task: TaskContext, where: Path) -> None: ...
async def unknown(task: TaskContext, where: Nowhere) -> None: ...  # type: ignore[name-defined]  # noqa: F821
async def not_annotated(task, part: str) -> None: ...  # type: ignore[no-untyped-def]
async def right(task: TaskContext) -> None: ...
async def two(context: RobotContext, other: str) -> None: ...
def plain(task: TaskContext) -> None: ...
def of_task(task: TaskContext, origin: str, goal: str) -> float: ...  # type: ignore[empty-body]
def seconds(origin: str, goal: str) -> float: ...  # type: ignore[empty-body]


class NotAsync:
    def run(self, task: TaskContext) -> None: ...


@pytest.mark.parametrize(
    ("register", "target", "message"),
    [
        ("local_task", plain, r"local task 'x': the function is not async; write `async def plain"),
        ("local_task", 3, "local task 'x': 3 is not a function"),
        ("local_task", by_name, "parameter 'speed' can only be given by name, .* remove the"),
        (
            "local_task",
            of_path,
            "parameter 'where' is annotated with .*Path.*: an argument is a text, which",
        ),
        ("local_task", unknown, "the annotation of 'where' cannot be read: name 'Nowhere' is not"),
        ("local_task", not_annotated, "'task' has no annotation; write `task: TaskContext` for"),
        ("local_task", NotAsync, "class NotAsync needs a method `async def run"),
        ("bid", NotAsync, "is not a function"),
        ("background", plain, "background function 'plain': the function is not async"),
        ("background", two, r"belongs to no task; write `async def two\(context: RobotContext\)"),
        ("background", right, r"belongs to no task; write `async def right\(context: RobotC"),
        ("travel", plain, "travel function 'plain': the function is not async"),
        ("travel", "base", "travel function \"'base'\": 'base' is not a function"),
        ("travel", right, r"is given a place; write `async def right\(task: TaskContext, place: s"),
        (
            "travel_time",
            plain,
            r"given two places; write `def plain\(origin: str, goal: str\) -> f",
        ),
        (
            "travel_time",
            of_task,
            "travel time function 'of_task': it belongs to no task; give it",
        ),
    ],
)
def test_what_cannot_be_called_is_refused_when_it_is_registered(
    register: str, target: Any, message: str
) -> None:
    decorator = getattr(RobotProgram(), register)
    with pytest.raises(ProgramError, match=message):
        (decorator("x") if register in ("local_task", "bid") else decorator)(target)


def test_a_name_is_not_empty() -> None:
    with pytest.raises(ProgramError, match="the name is empty"):
        RobotProgram().local_task("")(right)


async def test_one_function_drives_to_places() -> None:
    program, got = RobotProgram(), list[str]()
    assert functions_of(program).travel is None

    @program.travel
    async def drive(place: str, task: TaskContext) -> None:
        got.append(f"{task.robot} {place}")

    function = functions_of(program).travel
    assert function is not None
    await function(context(FakePort(), "lift", "red"), "shelf_1")
    assert got == ["A1 shelf_1"]
    with pytest.raises(ProgramError, match=r"'two': a program has one .* at \S+_function.py:\d+$"):
        program.travel(two)
    program.travel_time(seconds)
    with pytest.raises(ProgramError, match=r"'seconds': a program has one travel time function; t"):
        program.travel_time(seconds)


def test_without_a_name_that_of_the_function_counts() -> None:
    program = RobotProgram()

    @program.local_task
    async def carry(task: TaskContext, box: str) -> None: ...

    @program.local_task
    class Look:
        async def run(self) -> None: ...

    @program.bid
    def carry_bid(box: str) -> float:
        return 1.0

    @program.action
    async def open_gripper() -> None: ...

    @program.condition
    def is_open() -> bool:
        return True

    @program.entry
    def battery() -> float:
        return 1.0

    @program.source
    def robot_speed() -> float:
        return 0.5

    functions = functions_of(program)
    assert [*functions.local_tasks, *functions.bids] == ["carry", "Look", "carry_bid"]
    assert functions.leaves.names() == ["is_open", "open_gripper"]
    assert [*functions.leaves.entries, *functions.leaves.sources] == ["battery", "robot_speed"]


async def test_annotations_decide_where_the_context_goes() -> None:
    program, got = RobotProgram(), list[Any]()

    @program.local_task("first")
    async def first(task: TaskContext, part: str) -> None:
        got.append((task.robot, part))

    @program.local_task("last")
    async def last(part: str, robot: RobotContext) -> None:
        got.append((robot.robot, part))

    @program.local_task("named")
    async def named(part: str = "", *rest: str, task: "TaskContext") -> None:  # noqa: UP037
        got.append((task.robot, part, *rest))

    @program.local_task("none")
    async def none(*arguments: str) -> None:
        got.append(arguments)

    @program.local_task("method")
    class Method:
        async def run(self, part: int, task: TaskContext) -> None:
            got.append((task.robot, part))

    for name, *arguments in (
        ("first", "2"),
        ("last", "2"),
        ("named",),
        ("named", "2", "3"),
        ("none", "2"),
        ("method", "2"),
    ):
        await run(program, context(FakePort(), name, *arguments))
    assert got == [("A1", "2"), ("A1", "2"), ("A1", ""), ("A1", "2", "3"), ("2",), ("A1", 2)]


def test_a_second_registration_names_the_first() -> None:
    program = RobotProgram()
    program.local_task("x")(right)
    with pytest.raises(ProgramError, match=rf"registered twice, first at {__file__}:\d+$"):
        program.local_task("x")(two)


async def test_arguments_have_the_types_of_the_parameters() -> None:
    program, got = RobotProgram(), list[Any]()

    @program.local_task("x")
    async def x(
        task: TaskContext,
        a: int,
        b: float,
        c: bool,
        d: str,
        e: Optional[int] = None,  # noqa: UP045
        f: int | None = 7,
        *rest: float,
    ) -> None:
        got.extend([a, b, c, d, e, f, *rest])

    await run(program, context(FakePort(), "x", "-3", "2.5", "true", "007"))
    await run(program, context(FakePort(), "x", "1", "2", "0", "x", "4", "5", "6", "1e3"))
    assert got == [-3, 2.5, True, "007", None, 7, 1, 2.0, False, "x", 4, 5, 6.0, 1000.0]
    assert [type(value) for value in got[-2:]] == [float, float]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["abc"], "parameter 'part': the text 'abc' is not an integer"),
        (["1.5"], "parameter 'part': the text '1.5' is not an integer"),
        ([], "the function takes 1 argument besides the context, found 0"),
        (["1", "2"], "the function takes 1 argument besides the context, found 2"),
    ],
)
async def test_arguments_that_do_not_fit_are_a_failure_with_its_place(
    arguments: list[str], reason: str
) -> None:
    program = RobotProgram()

    @program.local_task("x")
    async def x(task: TaskContext, part: int) -> None:
        raise AssertionError(part)

    with pytest.raises(UserCodeError) as caught:
        await run(program, context(FakePort(), "x", *arguments))
    said = str(caught.value)
    assert said.startswith(reason)
    assert said.endswith(f"({Path(__file__).name}:{x.__code__.co_firstlineno})")


TYPED = """
from mrbt_mesh import RobotContext, RobotProgram, TaskContext

robot = RobotProgram()

@robot.local_task("a")
async def a(task: TaskContext, part: int, speed: float = 1.0) -> None: ...

@robot.local_task("b")
async def b(task: TaskContext, *arguments: str) -> bool:
    return True

@robot.local_task("c")
class C:
    async def run(self, task: TaskContext, part: str) -> None: ...

@robot.bid("a")
def bid(task: TaskContext, part: int) -> float:
    return 1.0

@robot.travel
async def drive(task: TaskContext, place: str) -> bool:
    return True

@robot.travel_time
def seconds(context: RobotContext, origin: str, goal: str) -> float | None:
    return None

@robot.background
async def sense(context: RobotContext) -> None:
    await d()
    await move("3")
    C()

@robot.local_task("w1")  # wrong
def w1(task: TaskContext) -> None: ...

@robot.local_task
async def d() -> None: ...

@robot.action("Move")
async def move(part: str) -> None: ...

@robot.local_task  # wrong
def w2(part: str) -> None: ...

@robot.local_task("w4")
class W4:  # wrong
    def run(self, task: TaskContext) -> None: ...

@robot.local_task("w5")  # wrong
async def w5(task: TaskContext) -> str:
    return "done"

@robot.bid("w6")  # wrong
def w6(task: TaskContext) -> str:
    return "far"

@robot.travel  # wrong
async def w8(place: str) -> float:
    return 0.5

@robot.travel_time  # wrong
def w9(origin: str, goal: str) -> str:
    return "far"

@robot.background  # wrong
def w7(task: TaskContext) -> None: ...
"""


@pytest.mark.slow
def test_type_checkers_see_wrong_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "robot.py"
    file.write_text(TYPED)
    monkeypatch.setenv("MYPYPATH", str(ROOT))
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    options = ["--strict", "--no-error-summary", "--python-version", version]
    options += ["--config-file", "", "--follow-imports", "silent", "--cache-dir", str(tmp_path)]
    said, problems, _ = api.run([*options, str(file)])
    found = [int(line.split(":")[1]) for line in said.splitlines() if ": error:" in line]
    lines = TYPED.splitlines()
    wrong = [number for number, line in enumerate(lines, 1) if line.endswith("# wrong")]
    assert found == wrong, said + problems


def test_a_decorator_without_a_name_may_have_brackets() -> None:
    program = RobotProgram()

    @program.local_task()
    async def weld(task: TaskContext) -> None: ...

    @program.bid()
    def grind(task: TaskContext) -> float:
        return 1.0

    assert functions_of(program).local_task("weld") is not None
    assert functions_of(program).bid("grind") is not None
