"""A bug in the robot's own code, wherever the event loop calls it: the robot stops as if killed.

A robot is alone, with a transport that only counts, and works. Then one of its parts raises.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from selectors import SelectorKey
from typing import Any

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import TokenChanged
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import driver
from mrbt_mesh.runtime.actions import ActionRunner
from mrbt_mesh.runtime.driver import BROKEN, BrokenRobotError, Driver
from mrbt_mesh.runtime.fencing import FencingSelector
from mrbt_mesh.runtime.flood_gate import FloodGate
from mrbt_mesh.runtime.inbox import Inbox
from mrbt_mesh.runtime.journal import journal_path
from mrbt_mesh.runtime.journal_writer import JournalWriter
from mrbt_mesh.runtime.recording import GuardedRecorder
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.robot_process import robot_setup
from mrbt_mesh.runtime.run_dir import RunDir

MISSION = """\
mission: one
program: robot.py
local_tasks: {work: {}, rest: {}}
robot_types: {r: {capabilities: {work: 1, rest: 1}}}
robots: {R1: r}
conditions: {heavy: {default: false}}
global_tasks: {work: {needs: {work: {min: 1}}}, rest: {needs: {rest: {min: 1}}}}
tree: {Sequence: [work, rest]}
"""
# Enough for everything that happens regularly to happen.
STEPS = 200


class Bug:
    """Raises once, when the program works and the part that has it is used."""

    def __init__(self) -> None:
        self.is_due = self.has_come = self.was_work_cancelled = False
        self.deliver: Callable[[Any, None], object] = lambda *_: None
        # How the transport has been used since then.
        self.used: list[str] = []

    def maybe(self) -> None:
        if self.is_due and not self.has_come:
            self.has_come = True
            self.used.clear()
            raise ZeroDivisionError("bug")


class Transport:
    """Reaches nobody, and has the bug where it is used as `part`."""

    def __init__(self, bug: Bug, part: str) -> None:
        self._bug = bug
        self._part = part

    def __getattr__(self, name: str) -> Any:
        def use(*_: Any) -> Any:
            if name == self._part:
                self._bug.maybe()
            self._bug.used.append(name)
            return []

        return use


def program(bug: Bug, journal: Path) -> RobotProgram:
    robot = RobotProgram()

    @robot.local_task("work")
    async def work(task: TaskContext) -> None:
        bug.is_due = True
        try:
            for number in range(STEPS):
                task.set_condition("heavy", number % 2 == 1, at_once=True)
                if number == 10:
                    journal.unlink()  # which the journal's thread reports
                bug.deliver(TokenChanged("R2", Incarnation(number, "n"), True), None)
                await anyio.sleep(0.01)
        except anyio.get_cancelled_exc_class():
            bug.was_work_cancelled = True
            raise

    @robot.local_task("rest")
    async def rest(task: TaskContext) -> None:
        await anyio.sleep_forever()

    return robot


def broken_robot(folder: Path, bug: Bug, monkeypatch: pytest.MonkeyPatch, part: str = "") -> str:
    """Run the robot until it breaks; why it has stopped."""
    file = folder / "mission.yaml"
    file.write_text(MISSION)

    def transport(config: Any, deliver: Any, lives: Any) -> Transport:
        bug.deliver = deliver
        return Transport(bug, part)

    monkeypatch.setattr(driver, "ZenohTransport", transport)
    options = RobotOptions(
        beat_s=0.05, detection_s=0.2, run_dir=folder, record=folder / "R1.mcap", insecure=True
    )
    own_program = program(bug, journal_path(folder, "R1"))
    own = Driver(robot_setup(load_mission(file), "R1", options, own_program, "the program"))
    if part == "on_step":
        own.on_step = bug.maybe
    with pytest.raises(BrokenRobotError) as error:
        own.run()
    assert own.stop is not None
    assert (own.stop.code, own.stop.reason) == (BROKEN, str(error.value))
    return str(error.value)


def is_named(name: str) -> Callable[..., bool]:
    return lambda event, *_: type(event).__name__ == name


def always(*_: Any) -> bool:
    return True


# Where the bug is: class, method, and for which arguments.
Place = tuple[type, str, Callable[..., bool]]
PLACES: dict[str, Place] = {
    "a step of the agent": (Agent, "handle", always),
    "a timer": (Agent, "handle", is_named("TimerFired")),
    "news of the journal": (Driver, "_submit", is_named("JournalReported")),
    "what comes from others": (Agent, "handle", is_named("TokenChanged")),
    "what the program reports": (Agent, "handle", is_named("ConditionSet")),
    "the end of an action": (Agent, "handle", is_named("ActionFinished")),
    "the next deadline": (Agent, "next_deadline_us", always),
    "effects": (Driver, "_carry_out", always),
    "the journal": (JournalWriter, "carry_out", always),
    "an action that begins": (ActionRunner, "carry_out", lambda e: isinstance(e, StartAction)),
    "the recording": (GuardedRecorder, "do", always),
    "the inbox": (Inbox, "take", always),
    "quiet heartbeats": (Inbox, "take_quiet", always),
    "refused messages": (FloodGate, "take_refused", always),
    "the sign of life": (RunDir, "mark_alive", always),
    "the log": (Driver, "log", always),
    "waking": (Driver, "_wake", always),
}


@pytest.mark.parametrize("place", PLACES)
def test_a_robot_stops_wherever_its_own_code_raises(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bug = Bug()
    owner, name, applies = PLACES[place]
    method = getattr(owner, name)

    def with_bug(self: Any, *arguments: Any, **named: Any) -> Any:
        if applies(*arguments):
            bug.maybe()
        return method(self, *arguments, **named)

    monkeypatch.setattr(owner, name, with_bug)
    check(tmp_path, bug, broken_robot(tmp_path, bug, monkeypatch))


@pytest.mark.parametrize("part", ["publish", "linked", "follow_tokens", "on_step"])
def test_of_its_transport_and_of_the_program_around_it_too(
    part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bug = Bug()
    check(tmp_path, bug, broken_robot(tmp_path, bug, monkeypatch, part))


def test_a_process_that_is_stopped_before_its_robot_is_ready_is_not_broken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class OftenStopped(FencingSelector):
        def select(self, timeout: float | None = None) -> list[tuple[SelectorKey, int]]:
            ready = super().select(timeout)
            self.on_gap()
            return ready

    monkeypatch.setattr(driver, "FencingSelector", OftenStopped)
    bug = Bug()
    # It comes as far as its work, and ends by the bug there.
    check(tmp_path, bug, broken_robot(tmp_path, bug, monkeypatch, "publish"))


def check(folder: Path, bug: Bug, reason: str) -> None:
    """It sent nothing afterwards, stopped its work, and wrote why."""
    assert "bug of mrbt: ZeroDivisionError: bug (test_driver_broken.py:" in reason
    assert not {"publish", "reply", "declare_token"} & set(bug.used), bug.used
    assert "close" in bug.used
    assert (folder / "R1.died").read_text() == reason
