"""Files of robots that grow to a limit, on disks that are full."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mrbt_mesh.runtime import limited_file
from mrbt_mesh.runtime.limited_file import LimitedLog, NewLines, append


def log(path: Path, limit_bytes: int = 1_000) -> LimitedLog:
    return LimitedLog(path, limit_bytes, lambda count, reason: f"{count} lost: {reason}")


def test_a_file_that_is_full_is_begun_anew_and_the_one_before_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    for number in range(25):
        append(path, b"%09d\n" % number, 100)
    assert path.read_text().split() == [f"{n:09d}" for n in range(20, 25)]
    assert (tmp_path / "a.log.1").read_text().split() == [f"{n:09d}" for n in range(10, 20)]
    assert len(list(tmp_path.iterdir())) == 2


def test_a_line_that_was_torn_does_not_spoil_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(b"whole\nto")
    append(path, b"next\n", 100)
    assert path.read_bytes() == b"whole\nto\nnext\n"


def test_lines_that_are_lost_are_counted_and_told_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    to = log(tmp_path / "a.log")
    to.write("one\n")
    with monkeypatch.context() as full:

        def fail(*_: object) -> int:
            raise OSError(errno.ENOSPC, "No space left on device")

        full.setattr(limited_file.os, "write", fail)
        to.write("two\n")
        to.write("three\n")
    to.write("four\n")
    told = (tmp_path / "a.log").read_text().splitlines()
    assert told == ["one", "2 lost: No space left on device", "four"]


def test_a_folder_that_is_missing_costs_lines_only(tmp_path: Path) -> None:
    folder = tmp_path / "later"
    to = log(folder / "a.log")
    to.write("one\n")
    folder.mkdir()
    to.write("two\n")
    assert (folder / "a.log").read_text() == "1 lost: No such file or directory\ntwo\n"


PRINTS = """
import os, sys
from pathlib import Path
from mrbt_mesh.runtime.limited_file import protect_output
protect_output(Path(sys.argv[1]) if len(sys.argv) > 1 else None, 1_000)
for number in range(300):
    print(f"{number:09d}")
print("error", file=sys.stderr)
os._exit(7)
"""


def test_prints_to_a_full_disk_are_dropped() -> None:
    with Path("/dev/full").open("wb") as full:
        ended = subprocess.run([sys.executable, "-c", PRINTS], stdout=full, stderr=full)
    assert ended.returncode == 7


def test_what_a_robot_prints_is_limited(tmp_path: Path) -> None:
    path = tmp_path / "A1.out"
    with path.open("ab") as output:
        command = [sys.executable, "-c", PRINTS, str(path)]
        ended = subprocess.run(command, stdout=output, stderr=output)
    assert ended.returncode == 7
    kept = [(path.with_name(name)).read_text().split() for name in ("A1.out.1", "A1.out")]
    assert kept[0] + kept[1] == [*(f"{n:09d}" for n in range(200, 300)), "error"]
    assert os.stat(path).st_size <= 1_000


def test_new_lines_are_followed_also_into_the_next_file(tmp_path: Path) -> None:
    path = tmp_path / "R1.log"
    lines = NewLines(path)
    assert [*lines.take()] == [], "there is no file yet"
    path.write_text("a\nb")
    assert [*lines.take()] == ["a"]
    with path.open("a") as file:
        file.write("c\nd\n")
    path.rename(tmp_path / "R1.log.1")
    path.write_text("e\n")
    assert [*lines.take()] == ["bc", "d", "e"]
    assert [*lines.take()] == []
