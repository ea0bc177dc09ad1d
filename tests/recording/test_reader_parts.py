"""A recording is read as it is at one moment, while its writer begins and removes parts."""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

import pytest

from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.recording import folder
from mrbt_mesh.recording.folder import part_path
from mrbt_mesh.recording.metadata import RunMetadata
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.recording.writer import RecordingWriter
from tests.support.build import action, make_mission, task

MISSION = make_mission(action("a1"), {"A": {"t": 1}}, [task("a1", ("t", 1, 1))])
ABOUT = {"changes": 0, "incarnation": "", "sequence": 0, "ticket": 0}


class KilledError(Exception):
    """The process of a writer ends."""


def killed() -> Iterator[Entry]:
    raise KilledError
    yield


class Rotating:
    """A recording of which only the two last parts are kept."""

    def __init__(self, path: Path) -> None:
        self.path, self.number = path, 1
        self.writer = RecordingWriter(
            path, RunMetadata.of(MISSION, "A", "r1", Timing(), 0, "1"), limit_bytes=1 << 20
        )
        self.write()

    def write(self) -> None:
        self.writer.write("/alive", self.number, {"robots": {"A": f"{self.number}.x"}})
        self.writer.flush(self.number)

    def rotate(self) -> None:
        """Begin the next part, and remove the last but one."""
        self.writer.begin_part(MISSION, (), ABOUT, self.number)
        part_path(self.path, self.number - 1).unlink(missing_ok=True)
        self.number += 1
        self.write()


@pytest.fixture
def rotating(tmp_path: Path) -> Iterator[Rotating]:
    found = Rotating(tmp_path / "A.mcap")
    found.rotate()
    found.rotate()
    yield found
    found.writer.close()


def test_parts_that_vanish_while_they_are_read_are_listed_again(
    rotating: Rotating, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[Path] = []
    plain: Callable[[Path], BinaryIO] = folder.open_regular

    def slow(path: Path) -> BinaryIO:
        opened.append(path)
        if len(opened) in (1, 3):
            rotating.rotate()
        return plain(path)

    monkeypatch.setattr("mrbt_mesh.recording.opened_parts.open_regular", slow)
    found = read_recording(rotating.path)
    assert [each.metadata.part for each in found.parts] == [4, 5]
    assert not found.damage
    assert found.records[-1].data["robots"] == {"A": "5.x"}


def test_what_is_written_when_it_is_read_stays_so(rotating: Rotating) -> None:
    """Its writer has gone on in another part when it is asked."""
    found = read_recording(rotating.path)
    rotating.rotate()
    assert not found.is_finished
    rotating.writer.close()
    assert read_recording(rotating.path).is_finished


@pytest.mark.parametrize("size", [0, 200, None], ids=["made", "begun", "metadata"])
@pytest.mark.parametrize("is_held", [True, False], ids=["written", "killed"])
def test_a_part_that_has_only_been_begun_is_none(
    rotating: Rotating, size: int | None, is_held: bool
) -> None:
    before = read_recording(rotating.path)
    with pytest.raises(KilledError):
        rotating.writer.begin_part(MISSION, killed(), ABOUT, 9)
    rotating.writer.abandon()
    part = part_path(rotating.path, rotating.number + 1)
    part.write_bytes(part.read_bytes()[:size])
    with part.open("rb") as file:
        if is_held:
            fcntl.flock(file, fcntl.LOCK_EX)
        found = read_recording(rotating.path)
    assert not found.damage
    assert found.is_finished is not is_held
    assert found.cut_off_at is not None
    assert [*found.records.times_us] == [*before.records.times_us]
