"""Who watches a team with keys: whom it believes, also while its members change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh.core.agent.inputs import AnswerReceived, Input, MessageReceived, TokenChanged
from mrbt_mesh.core.agent.operator_messages import CommandStep, command_version
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.envelope import Guard
from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.wire import (
    Heartbeat,
    MessageKind,
    SelfReport,
    encode,
    write_heartbeat,
)
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime import watcher as watcher_module
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.runtime.robot_options import NetworkOptions
from mrbt_mesh.runtime.team_address import TeamAddress, on_network
from mrbt_mesh.runtime.token_holders import LifeOf
from mrbt_mesh.runtime.watcher import MANIFEST_US, Watcher
from tests.support.paths import mission_file

Deliver = Callable[[Input, str | None], None]
BEAT, ANSWER = MessageKind.HEARTBEAT, MessageKind.ANSWER


class Wire:
    """A transport of which the test says what comes over it."""

    answers: tuple[bytes, ...] = ()

    def __init__(self, _: Any, deliver: Deliver, __: LifeOf) -> None:
        self.deliver = deliver

    def open(self) -> None:
        pass

    def declare_token(self, _: Any) -> None:
        pass

    def ask(self, peer: str, _: Any, __: bytes, ___: float, deliver: Deliver | None = None) -> None:
        if deliver is None:
            return
        for answer in self.answers:
            deliver(AnswerReceived(peer, answer), None)
        deliver(AnswerReceived(peer, None), None)


class Desk:
    """A watcher, and the team's keys."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.mission: Mission = load_mission(mission_file("explore"))
        members = {"R1": Role.ROBOT, "R2": Role.ROBOT, "operator": Role.OPERATOR}
        self.keys = KeyFolder.create(folder / "keys", members)
        self.now_us = 1
        monkeypatch.setattr(watcher_module, "ZenohTransport", Wire)
        monkeypatch.setattr(watcher_module, "boottime_us", lambda: self.now_us)
        self.address: TeamAddress = on_network(
            self.mission, NetworkOptions(run="run", keys=self.keys.path)
        )
        self.watcher = Watcher(self.address)

    def guard(self, robot: str) -> Guard:
        return Guard(self.keys.keys_of(robot), "run", 1)

    def operate(self, *answers: bytes) -> dict[str, Any] | None:
        async def ask() -> dict[str, Any] | None:
            await self.watcher.open()
            self.wire.answers = answers
            version = command_version(1, "c")
            pause = self.watcher.make_command("paused", "pause", "me", version)
            return await self.watcher.operate("R1", CommandStep.WRITE, pause, True)

        return anyio.run(ask)

    def answer(self, good: bool, text: Any) -> bytes:
        return encode(self.watcher.observer.replica.header, ANSWER, [good, text])

    def command(self, *answers: bytes) -> tuple[bool, str]:
        async def ask() -> tuple[bool, str]:
            await self.watcher.open()
            self.wire.answers = answers
            return await self.watcher.command("R1", "leave")

        return anyio.run(ask)

    @property
    def wire(self) -> Wire:
        wire = self.watcher._transport
        assert isinstance(wire, Wire)
        return wire


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    return Desk(tmp_path, monkeypatch)


def test_what_the_robot_has_signed_counts_whoever_else_answers_first(desk: Desk) -> None:
    signed = desk.guard("R1").seal(desk.answer(True, "R1 leaves"), ("operator",))
    forged = desk.answer(False, "R1 does not want to")
    others = desk.guard("R2").seal(desk.answer(False, "nor do I"), ("operator",))
    assert desk.command(b"noise", forged, others, signed) == (True, "R1 leaves")


def test_an_answer_that_nobody_has_signed_is_told_and_does_not_count(desk: Desk) -> None:
    assert desk.command(desk.answer(True, "R1 refuses this")) == (False, "R1 refuses this")
    assert desk.command() == (False, "R1 does not answer")
    good, text = desk.command(b"noise")
    assert not good
    assert text.startswith("R1 answered something strange")


def test_what_became_of_a_command_is_plain_data_that_a_terminal_can_show(desk: Desk) -> None:
    robot = desk.guard("R1")

    def signed(good: bool, found: Any) -> bytes:
        return robot.seal(desk.answer(good, found), ("operator",))

    found = {"taken": True, "stamp": 4, "state": {"reason": "\x1b]0;", "robots": ["R1"]}}
    shown = found | {"state": {"reason": "?]0;", "robots": ["R1"]}}
    assert desk.operate(signed(True, found)) == shown
    assert desk.operate(signed(True, "yes")) is None
    assert desk.operate() is None
    assert desk.operate(signed(False, "R1 refuses this")) == {
        "refused": "R1 refuses this",
        "cause": "invalid",
    }


def test_a_member_that_is_new_or_has_another_key_is_heard(desk: Desk) -> None:
    async def hear(robot: str, guard: Guard) -> dict[str, str]:
        await desk.watcher.open()
        desk.now_us += MANIFEST_US
        desk.watcher.refresh()
        desk.watcher.observer.refused.clear()
        desk.wire.deliver(MessageReceived(BEAT, robot, guard.seal(b"x")), None)
        await desk.watcher.changed.wait()
        return desk.watcher.observer.refused

    before, revoked = desk.guard("R1"), desk.guard("R2")
    desk.keys.add({"R3": Role.ROBOT, "R1": Role.ROBOT}, replaces=True)
    for robot in ("R1", "R3"):
        refused = anyio.run(hear, robot, desk.guard(robot))
        assert "not msgpack" in refused[robot] or "not a message" in refused[robot], "opened"
    assert "signature is wrong" in anyio.run(hear, "R1", before)["R1"]
    desk.keys.revoke(["R2"])
    assert "'R2' has no key in this team" in anyio.run(hear, "R2", revoked)["R2"]


def test_a_manifest_of_another_team_is_told_and_not_taken_over(desk: Desk, tmp_path: Path) -> None:
    other = KeyFolder.create(tmp_path / "other", {"operator": Role.OPERATOR})
    desk.keys.manifest_path.write_text(other.manifest_path.read_text())
    desk.now_us += MANIFEST_US

    async def look() -> None:
        await desk.watcher.open()
        desk.watcher.refresh()

    anyio.run(look)
    ((_, text),) = desk.watcher.observer.record.timeline
    assert "the new manifest is refused" in text


def test_messages_of_a_burst_are_taken_in_together_each_at_its_time(desk: Desk) -> None:
    def arrives(robot: str, at_us: int) -> None:
        desk.now_us = at_us
        report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 0)
        beat = Heartbeat(report, False, bytes(8), (0,) * 4, 0, (), {})
        header = replace(desk.watcher.observer.replica.header, sender=robot)
        data = desk.guard(robot).seal(write_heartbeat(beat, header))
        desk.wire.deliver(MessageReceived(BEAT, robot, data), f"beat/{robot}")

    async def watch() -> dict[str, int]:
        watcher = desk.watcher = Watcher(desk.address, batch_s=0.05)
        await watcher.open()
        arrives("R1", 1_000)
        await watcher.changed.wait()
        joined_us = watcher.observer.record.joined_us
        watcher.changed = anyio.Event()
        # When a token came is not known, but for what followed it.
        desk.wire.deliver(TokenChanged("R2", Incarnation(1, "n"), True, ""), None)
        arrives("R2", 2_000)
        # The thread that received this one had to wait, and puts it behind a later one.
        arrives("R1", 1_500)
        await anyio.lowlevel.checkpoint()
        assert list(joined_us) == ["R1"]
        desk.now_us = 50_000
        await watcher.changed.wait()
        return joined_us

    assert anyio.run(watch) == {"R1": 1_000, "R2": 2_000}


@pytest.mark.parametrize(("late_us", "state"), [(0, State.SUSPECT), (1_000_000, State.ALIVE)])
def test_who_watches_and_was_slow_suspects_nobody_for_it(
    desk: Desk, late_us: int, state: State
) -> None:
    """Silence that it has heard itself counts; what came while it did not look is unread."""
    beat_us = desk.address.timing.heartbeat_us
    report = SelfReport(Incarnation(1, "n"), 1, bytes(8), True, 0)
    beat = Heartbeat(report, False, bytes(8), (0,) * 4, 0, (), {})

    async def watch() -> State:
        watcher = desk.watcher
        await watcher.open()
        watcher.changed.set()
        await watcher.wait_for_change(beat_us / 1e6)
        members = watcher.observer.membership
        members.receive_heartbeat("R1", beat, desk.now_us)
        silent_us, step_us = 1_000_000, late_us or beat_us
        while silent_us > 0:
            silent_us -= step_us
            desk.now_us += step_us
            watcher.changed.set()
            await watcher.wait_for_change(beat_us / 1e6)
        return members.peers["R1"].state

    assert anyio.run(watch) is state
