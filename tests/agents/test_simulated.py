"""The simulated robots: what they do, and that they record it exactly once."""

import sys
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.formats.shipped import template_files, write_files
from mrbt_mesh.runtime.context import Simulation
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.runtime.user_code import UserCodeError
from tests.support.fake_port import FakePort, cancelled_while_working, context, outcomes, run
from tests.support.paths import ROOT

AGENTS = ROOT / "agents"


@pytest.fixture(autouse=True)
def _own_import_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading a program puts its folder on the path, which other tests should not see."""
    monkeypatch.setattr(sys, "path", list(sys.path))


def agent(name: str) -> RobotProgram:
    return load_program(str(AGENTS / f"{name}.py"))


@pytest.mark.parametrize(("part", "is_broken"), [("2", True), ("3", False), ("22", False)])
async def test_a_diagnosis_finds_what_the_parameters_say(part: str, is_broken: bool) -> None:
    port = FakePort()
    task = context(port, "do_diagnosis", part, parameters={"broken_parts": [2, 4]})
    assert await run(agent("repair"), task)
    assert port.conditions == {f"broken({part})": is_broken}


async def test_a_start_and_an_end_are_recorded_in_full() -> None:
    port = FakePort()
    await run(agent("repair"), context(port, "replace_hw(2)", "2"))
    common = {
        "robot": "A1",
        "pid": 42,
        "incarnation": "7-abc",
        "activation": "act-1",
        "global_task": "goal",
        "local_task": "replace_hw",
        "args": ["2"],
    }
    assert port.events == [
        {**common, "t": 1001.0, "event": "start", "outcome": None},
        {**common, "t": 1002.0, "event": "end", "outcome": "success"},
    ]


async def test_work_reports_progress_in_20_steps_up_to_1() -> None:
    port = FakePort()
    await run(agent("explore"), context(port, "explore", "A"))
    assert len(port.progress) == 20
    assert port.progress == sorted(port.progress)
    assert port.progress[-1] == 1.0


async def test_work_takes_work_by_performance_and_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)

    program, port = agent("explore"), FakePort()
    monkeypatch.setattr(anyio, "sleep", sleep)
    await run(program, context(port, "explore", "A", simulation=Simulation(duration_s=0.5)))
    assert sum(slept) == pytest.approx(0.5)


@pytest.mark.parametrize("task", ["use_screwdriver", "move_frame", "use_soldering_iron"])
async def test_other_repairs_are_only_work(task: str) -> None:
    port = FakePort()
    assert await run(agent("repair"), context(port, task))
    assert outcomes(port) == [("start", None), ("end", "success")]
    assert port.conditions == {}


@pytest.mark.parametrize(
    ("task", "fails"),
    [
        (("search", "1"), True),
        (("search", "2"), False),
        (("large_screwdriver",), True),
        (("small_screwdriver",), False),
        (("large_screwdriver", "fits"), False),
    ],
)
async def test_tool_search_fails_as_the_parameters_say(task: tuple[str, ...], fails: bool) -> None:
    port = FakePort()
    task, fits = (task[:1], True) if task[-1] == "fits" else (task, False)
    parameters = {"tools_in_storage": 2, "large_fits": fits}
    running = run(agent("tool_search"), context(port, *task, parameters=parameters))
    if fails:
        with pytest.raises(UserCodeError):
            await running
    else:
        await running
    assert outcomes(port) == [("start", None), ("end", "failure" if fails else "success")]


def held_program() -> RobotProgram:
    """A program whose task `x` only waits while it is held."""
    agent("repair")  # Puts the folder on the path.
    from simulated import held

    program = RobotProgram(record_work=True)

    @program.local_task("x")
    async def x(task: TaskContext, part: str) -> None:
        await held(task)

    return program


@pytest.mark.parametrize("name", ["A1", "x(2)", "x", "goal"])
async def test_what_is_held_has_started_and_goes_on_when_it_is_let_go(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold = tmp_path / "hold"
    hold.write_text(f"A2\nx(3)\n{name}\n")
    monkeypatch.setenv("MRBT_HOLD", str(hold))
    turns = anyio.Semaphore(0)

    async def sleep(_: float) -> None:
        await turns.acquire()

    monkeypatch.setattr(anyio, "sleep", sleep)

    port, program = FakePort(), held_program()
    async with anyio.create_task_group() as group:
        group.start_soon(run, program, context(port, "x(2)", "2"))
        turns.release()
        await anyio.wait_all_tasks_blocked()
        assert outcomes(port) == [("start", None)]
        hold.unlink() if name == "A1" else hold.write_text("A2\nx(3)\n")
        turns.release()
    assert outcomes(port) == [("start", None), ("end", "success")]


async def test_a_cancelled_diagnosis_says_nothing_of_the_part() -> None:
    port = FakePort()
    task = context(port, "do_diagnosis", "2", simulation=Simulation(duration_s=1e9))
    assert await cancelled_while_working(agent("repair"), task)
    assert outcomes(port) == [("start", None), ("cancel", None)]
    assert port.conditions == {}


async def test_the_template_robot_records_tasks_and_a_cancellation(
    tmp_path: Path,
) -> None:
    program = load_program(str(write_files(tmp_path, template_files("team"))[1]))
    port = FakePort()
    task = context(port, "look_at", "green", parameters={"heavy_boxes": ["green"]})
    await run(program, task)
    await run(program, context(port, "carry", "green"))
    assert port.conditions == {"heavy(green)": True}
    assert outcomes(port) == [("start", None), ("end", "success")] * 2
    with pytest.raises(UserCodeError, match="KeyError"):
        await run(program, context(port, "look_at", "red"))
    assert outcomes(port)[-1] == ("end", "failure")
    port = FakePort()
    task = context(port, "carry", "red", simulation=Simulation(duration_s=1e9))
    assert await cancelled_while_working(program, task)
    assert outcomes(port) == [("start", None), ("cancel", None)]
