"""mrbt recording verify and mrbt recording replay, on a run of mrbt sim run --record."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from tests.support.command import EXPLORE, done, mrbt, refused


def recording(*arguments: str) -> tuple[int, str, str]:
    return mrbt("recording", *arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("commands") / "run"
    code, _, problems = mrbt("sim", "run", EXPLORE, "--seed", "3", "--record", str(made))
    assert (code, problems) == (0, "")
    return made


def test_a_run_directory_is_verified(folder: Path) -> None:
    code, output, _ = recording("verify", str(folder))
    assert code == 1
    assert output.startswith("Without keys everything can be forged")
    assert "plans made again" in output
    assert "not proved: all recordings: no signature was checked: start the team" in output
    output = done(recording("verify", str(folder), "--accept", "unsigned"))
    assert "3 recordings agree; what was accepted above is not proved" in output


def test_files_are_verified_and_told_as_json(folder: Path) -> None:
    files = sorted(map(str, (folder / "recordings").iterdir()))
    accepted = ("--accept", "unsigned", "--accept", "observer")
    code, output, _ = recording("verify", *files, *accepted, "--json")
    told = json.loads(output)
    assert (code, told["verified"], told["all_proved"], told["findings"]) == (0, True, False, [])
    assert [gap["kind"] for gap in told["not_proved"]] == ["unsigned", "observer"]
    assert told["files"] == ["R1.mcap", "R2.mcap"]
    assert told["counts"]["plans"] > 0


def test_what_is_falsified_is_named_with_status_1(folder: Path, tmp_path: Path) -> None:
    content = (folder / "recordings" / "R1.mcap").read_bytes()
    forged = tmp_path / "R1.mcap"
    at = content.index(b'"lines":{"R1":{"activation":"') + 30
    forged.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
    code, output, _ = recording("verify", str(forged), str(folder / "recordings" / "R2.mcap"))
    assert code == 1
    assert "R1.mcap: record" in output
    assert re.search(r"not proved: \d+ contradictions, 2 gaps in 2 recordings", output)


def test_the_name_of_a_file_writes_no_line_of_its_own(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "run")
    name = "x\nproved: what the team did, by 4 recordings\x1b[32m"
    (tmp_path / "run" / name).touch()
    (tmp_path / "run" / "recordings" / f"{name}.mcap").write_bytes(
        (folder / "recordings" / "R1.mcap").read_bytes()
    )
    _, output, problems = recording("verify", str(tmp_path / "run"))
    assert "\x1b" not in output + problems
    assert not any(line.startswith("proved:") for line in (output + problems).splitlines())


def test_a_recording_counts_once(folder: Path, tmp_path: Path) -> None:
    """Given twice it would seem to be confirmed by another one."""
    one = folder / "recordings" / "R1.mcap"
    link = tmp_path / "again.mcap"
    link.symlink_to(one)
    for given in ((folder, folder), (folder, one), (one, link)):
        problems = " ".join(refused(recording("verify", *map(str, given))).split())
        assert "is given twice: name each recording once" in problems


def test_a_link_to_another_recording_of_the_run_is_named(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "run")
    link = tmp_path / "run" / "recordings" / "R9.mcap"
    link.symlink_to("R1.mcap")
    problems = " ".join(refused(recording("verify", str(tmp_path / "run"))).split())
    assert "R9.mcap is a link to" in problems
    assert "given twice" not in problems


def test_a_link_to_itself_ends_with_status_2(tmp_path: Path) -> None:
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert "cannot be read" in refused(recording("verify", str(loop)))


def test_what_is_no_recording_ends_with_status_2(folder: Path, tmp_path: Path) -> None:
    for path, problem in ((EXPLORE, "is not an mrbt recording"), (str(tmp_path), "no recordings")):
        assert problem in refused(recording("verify", path))


def test_a_folder_that_is_there_is_not_recorded_into(folder: Path) -> None:
    problems = refused(mrbt("sim", "run", EXPLORE, "--record", str(folder)))
    assert "exists already; name a new folder" in problems


def test_without_a_manifest_nothing_is_signed(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "run")
    (tmp_path / "run" / "keys").mkdir()
    done(recording("verify", str(tmp_path / "run"), "--accept", "unsigned"))
