"""What a server was told is open is remembered from one process to the next."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.adapters.rmf import told_tasks
from mrbt_mesh.adapters.rmf.told_tasks import ToldTasks


def state(name: str, status: str = "queued") -> dict[str, Any]:
    return {"booking": {"id": name}, "status": status}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    return tmp_path / "rmf"


def unwarned(text: str) -> None:
    pytest.fail(text)


def note(told: ToldTasks, each: dict[str, Any]) -> None:
    told.will_send(each)
    told.has_sent(each)


def ids(told: ToldTasks, *known: str) -> list[str]:
    return [each["booking"]["id"] for each in told.not_among(known)]


def test_open_tasks_are_remembered_until_their_end_is_told(folder: Path) -> None:
    told = ToldTasks("server fleet", unwarned)
    for each in (state("a"), state("b"), state("c"), state("b", "underway"), state("c", "failed")):
        note(told, each)
    assert ids(told, "a") == ["b"]
    again = ToldTasks("server fleet", unwarned)
    assert again.not_among(()) == [state("a"), state("b")]
    assert ids(ToldTasks("another fleet", unwarned)) == []
    for name in "ab":
        note(again, state(name, "completed"))
    assert ids(ToldTasks("server fleet", unwarned)) == []
    assert not list(folder.iterdir()), "nothing is left of it"


def test_files_of_servers_that_nobody_connects_to_are_removed(folder: Path) -> None:
    note(ToldTasks("one server", unwarned), state("a"))
    (old,) = folder.iterdir()
    note(ToldTasks("other server", unwarned), state("b"))
    long_ago_s = time.time() - told_tasks.UNUSED_S - 60
    os.utime(old, (long_ago_s, long_ago_s))
    assert ids(ToldTasks("other server", unwarned)) == ["b"]
    assert not old.exists()
    assert len(list(folder.iterdir())) == 1


def test_the_file_does_not_grow_without_end(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(told_tasks, "SPARE_LINES", 10)
    told = ToldTasks("x", unwarned)
    note(told, state("stays"))
    for number in range(100):
        note(told, state(str(number)))
        note(told, state(str(number), "completed"))
    (file,) = folder.iterdir()
    assert len(file.read_text().splitlines()) <= 14
    assert ids(ToldTasks("x", unwarned)) == ["stays"]


DAMAGED = ["{", "[]", "7", '{"booking": 1}', "\xff", '{"booking": {}}', "[" * 100_000]


@pytest.mark.parametrize("text", DAMAGED, ids=range(len(DAMAGED)))
def test_a_damaged_file_costs_its_damaged_lines_alone_and_is_mended(
    folder: Path, text: str
) -> None:
    told = ToldTasks("x", unwarned)
    note(told, state("a"))
    (file,) = folder.iterdir()
    file.write_bytes(text.encode("latin-1") + b"\n" + file.read_bytes())
    said: list[str] = []
    assert ids(ToldTasks("x", said.append)) == ["a"]
    assert ["1 damaged lines" in each for each in said] == [True]
    assert ids(ToldTasks("x", unwarned)) == ["a"]


def test_without_a_folder_it_is_kept_in_memory_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path / "file"))
    said: list[str] = []
    told = ToldTasks("x", said.append)
    note(told, state("a"))
    assert ids(told) == ["a"]
    assert ["cannot be kept on disk" in each for each in said] == [True]


def test_what_could_not_be_written_is_written_later(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    told = ToldTasks("x", said.append)
    note(told, state("a"))

    def no_space(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as full:
        full.setattr("builtins.open", no_space)
        full.setattr(told_tasks, "write_atomically", no_space)
        for name in "bc":
            note(told, state(name))
    assert len(said) == 1
    assert "No space left" in said[0]
    assert ids(told) == ["a", "b", "c"]
    note(told, state("d"))
    assert ids(ToldTasks("x", unwarned)) == ["a", "b", "c", "d"]


def test_an_end_that_was_not_sent_is_still_to_be_told(folder: Path) -> None:
    told = ToldTasks("x", unwarned)
    note(told, state("a"))
    told.will_send(state("a", "completed"))
    assert ids(ToldTasks("x", unwarned)) == ["a"]
