"""Functions of programs: what may be registered, and what their arguments become."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Optional

import pytest
from mypy import api

from mrbt_mesh import ProgramError, RobotProgram, TaskContext
from mrbt_mesh.runtime.user_code import UserCodeError
from tests.support.fake_port import FakePort, context, run
from tests.support.paths import ROOT


async def no_task() -> None: ...
async def text_first(part: str) -> None: ...
async def by_name(task: TaskContext, *, speed: float) -> None: ...
async def of_path(task: TaskContext, where: Path) -> None: ...
async def unknown(task: TaskContext, where: Nowhere) -> None: ...  # type: ignore[name-defined]  # noqa: F821
async def right(task: TaskContext) -> None: ...
async def two(task: TaskContext, other: str) -> None: ...
def plain(task: TaskContext) -> None: ...


class NotAsync:
    def run(self, task: TaskContext) -> None: ...


class WithoutTask:
    async def run(self) -> None: ...


def task(program: RobotProgram, name: Any, target: Any) -> None:
    program.local_task(name)(target)


def bid(program: RobotProgram, name: Any, target: Any) -> None:
    program.bid(name)(target)


def background(program: RobotProgram, _: Any, target: Any) -> None:
    program.background(target)


@pytest.mark.parametrize(
    ("register", "name", "target", "message"),
    [
        (task, "x", plain, r"local task 'x': the function is not async; write `async def plain"),
        (task, "x", 3, "local task 'x': 3 is not a function"),
        (task, "x", no_task, r"no parameter for the task; write no_task\(task: TaskContext"),
        (task, "x", text_first, "the first parameter gets the task; write text_first"),
        (task, "x", by_name, "parameter 'speed' can only be given by name, .* remove the"),
        (
            task,
            "x",
            of_path,
            "parameter 'where' is annotated with .*Path.*: an argument is a text, which",
        ),
        (task, "x", unknown, "the annotation of 'where' cannot be read: name 'Nowhere' is not"),
        (task, "x", NotAsync, "class NotAsync needs a method `async def run"),
        (task, "x", WithoutTask, r"write run\(self, task: TaskContext, ...\)"),
        (task, right, right, r'needs a name: write @robot.local_task\("right"\)'),
        (task, "", right, "needs a name"),
        (bid, plain, plain, r'needs a name: write @robot.bid\("plain"\)'),
        (bid, "x", no_task, "no parameter for the task"),
        (bid, "x", NotAsync, "is not a function"),
        (background, "", plain, "background function 'plain': the function is not async"),
        (background, "", no_task, "no parameter for the task"),
        (background, "", two, r"called with the task alone; write `async def two\(task: Task"),
    ],
)
def test_what_cannot_be_called_is_refused_when_it_is_registered(
    register: Callable[..., None], name: Any, target: Any, message: str
) -> None:
    with pytest.raises(ProgramError, match=message):
        register(RobotProgram(), name, target)


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
        (["abc"], "parameter 'part': the text 'abc' is no integer"),
        (["1.5"], "parameter 'part': the text '1.5' is no integer"),
        ([], "the function takes 1 argument besides the task, found 0"),
        (["1", "2"], "the function takes 1 argument besides the task, found 2"),
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
from mrbt_mesh import RobotProgram, TaskContext

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

@robot.background
async def sense(task: TaskContext) -> None:
    await a(task, 3)
    C()

@robot.local_task("w1")  # wrong
def w1(task: TaskContext) -> None: ...

@robot.local_task("w2")  # wrong
async def w2() -> None: ...

@robot.local_task("w3")  # wrong
async def w3(part: str) -> None: ...

@robot.local_task("w4")
class W4:  # wrong
    def run(self, task: TaskContext) -> None: ...

@robot.local_task("w5")  # wrong
async def w5(task: TaskContext) -> str:
    return "done"

@robot.bid("w6")  # wrong
def w6(task: TaskContext) -> str:
    return "far"

@robot.background  # wrong
def w7(task: TaskContext) -> None: ...
"""


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
