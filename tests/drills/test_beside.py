"""Processes beside a drill's team: started, asked, and none left behind."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import psutil
import pytest

from mrbt_mesh.drills.beside import Beside, BesideError, Check, beside, words

# Says that it is there, where those beside it look, and stays.
STAYS = "python stays.py"
STAYING = """
import os, pathlib, signal, sys, time
if sys.argv[1:] == ["stubborn"]:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
there = pathlib.Path(os.environ["MRBT_BESIDE"], "there")
there.with_suffix(".part").write_text(os.getcwd())
there.with_suffix(".part").rename(there)  # never seen half written
time.sleep(600)
"""
ASKING = """
import os, pathlib, time
path = pathlib.Path(os.environ["MRBT_BESIDE"], "there")
while not path.exists():
    time.sleep(0.01)
print("it is in", path.read_text())
raise SystemExit(int(os.environ["STATUS"]))
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "stays.py").write_text(STAYING)
    (tmp_path / "asks.py").write_text(ASKING)
    return tmp_path


def children() -> set[int]:
    return {process.pid for process in psutil.Process().children()}


def around(status: int = 0) -> dict[str, str]:
    return {**os.environ, "STATUS": str(status)}


@pytest.mark.parametrize("status", [0, 3])
def test_what_is_beside_the_team_is_asked_in_the_folder_that_they_share(
    folder: Path, status: int
) -> None:
    before = children()
    with beside([STAYS], folder, around(status)) as found:
        shared = Path(found.environment["MRBT_BESIDE"])
        said = found.check("python asks.py")
        assert said == Check("python asks.py", status, f"it is in {folder}")
        assert found.ended() == []
        assert len(children() - before) == 1
    assert children() == before
    assert not shared.exists()


def test_one_that_does_not_mind_being_asked_to_end_is_killed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mrbt_mesh.drills.beside.END_TIMEOUT_S", 0.1)
    before = children()
    with beside([f"{STAYS} stubborn"], folder, around()) as found:
        assert found.check("python asks.py").status == 0
    assert children() == before


def test_none_is_left_when_a_later_one_does_not_start(folder: Path) -> None:
    before = children()
    with (
        pytest.raises(BesideError, match="no-such-program now: No such file"),
        beside([STAYS, "no-such-program now"], folder, around()),
    ):
        pass
    assert children() == before


def test_one_that_has_ended_says_what_it_said_last(folder: Path) -> None:
    (folder / "ends.py").write_text("print('x' * 999)\nraise SystemExit('no model')\n")
    with beside(["python ends.py"], folder, around()) as found:
        found._processes[0][1].wait(60)
        (said,) = found.ended()
    assert said.startswith("python ends.py has ended with status 1: ...")
    assert said.endswith("no model")


def test_a_check_that_gives_no_answer(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mrbt_mesh.drills.beside.CHECK_TIMEOUT_S", 0.1)
    found = Beside(folder, folder, around())
    assert found.check(STAYS) == Check(STAYS, None, "no answer within 0.1 s")
    assert found.check("no-such-program").said == "No such file or directory"


def test_words_of_a_command() -> None:
    assert words("python 'a b.py' --x") == [sys.executable, "a b.py", "--x"]
    assert words("gzserver -r world.sdf") == ["gzserver", "-r", "world.sdf"]
    for wrong in ("", "  ", "python 'a"):
        with pytest.raises(ValueError, match=r"no command|No closing quotation"):
            words(wrong)
