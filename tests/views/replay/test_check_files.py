"""The other files of a run: signed, or held against the recordings, or named as no evidence."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.errors import InputError
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.runtime.command_log import head_of
from mrbt_mesh.runtime.member_keys import Manifest
from mrbt_mesh.runtime.summary_signature import Covered, signature_of
from mrbt_mesh.views.replay.check_files import RunDirFiles, read_run_dir_files
from mrbt_mesh.views.replay.check_summary import SummaryFile
from mrbt_mesh.views.replay.findings import GapKind
from mrbt_mesh.views.replay.verify import verify
from tests.support.keys import keys_of
from tests.support.recorded import read_all, record_keyed
from tests.support.runs import example

Run = tuple[list[Recording], Manifest, bytes]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("files")
    result, manifest = record_keyed(folder, "explore", 3)
    return read_all(folder), manifest, json.dumps(result.summary).encode()


def files_of(run: Run, commands: bytes | None, signed: bytes | None) -> RunDirFiles:
    """With a summary that was signed when the commands were `signed`."""
    key = keys_of("R1", "R2", observer="eye")["eye"]
    text = signature_of(key, run[2], Covered(run[0][0].metadata.run, head_of(signed)))
    mission = {"mission.json": compile_mission(example("explore")[0])}
    return RunDirFiles(SummaryFile(run[2], text), commands, mission)


def found(run: Run, files: RunDirFiles) -> list[str]:
    verdict = verify(*run[:2], files)
    return [str(each) for each in (*verdict.findings, *verdict.gaps)]


LINE = b'{"unix_s": 1.0, "by": "mrbt kill", "command": "D2 killed", "after": ""}\n'


def test_without_commands_nothing_is_missing(run: Run) -> None:
    assert found(run, files_of(run, None, None)) == []


def test_a_command_that_nobody_signed_is_a_gap(run: Run) -> None:
    verdict = verify(*run[:2], files_of(run, LINE, LINE))
    (gap,) = verdict.gaps
    assert gap.kind is GapKind.COMMANDS
    assert "line 1 is not signed by an operator" in gap.text
    assert [each.signer for each in verdict.commands] == [""]


def test_commands_removed_after_the_summary_was_signed_are_missed(run: Run) -> None:
    for commands in (None, b""):
        (text,) = found(run, files_of(run, commands, LINE))
        assert text.startswith("commands.jsonl: it lacks lines that were there")


def test_another_mission_is_named(run: Run) -> None:
    files = files_of(run, None, None)
    other = compile_mission(example("dispense")[0])
    (text,) = found(run, replace(files, missions={"mission.json": other}))
    assert "not the mission with which the recorded team was started" in text
    (text,) = found(run, replace(files, missions={"revision.json": "{}"}))
    assert "it is not a compiled mission" in text


def test_another_text_of_the_same_mission_is_named(run: Run) -> None:
    files = files_of(run, None, None)
    again = json.dumps(json.loads(files.missions["mission.json"]), indent=2) + "\n"
    (text,) = found(run, replace(files, missions={"mission.json": again}))
    assert text == "mission.json: it is not as mrbt writes it"


def test_files_that_nothing_signs_are_named(run: Run, tmp_path: Path) -> None:
    for name in ("deaths.json", "events.jsonl", "commands.jsonl", "run.mcap"):
        (tmp_path / name).touch()
    files = read_run_dir_files(tmp_path)
    assert files.others == ("deaths.json", "events.jsonl")
    verdict = verify(*run[:2], files)
    assert verdict.no_evidence == files.others
    assert any("the end of commands.jsonl is not proved" in each for each in verdict.notes)


@pytest.mark.parametrize("name", ["commands.jsonl", "summary.json", "mission.json"])
def test_only_regular_files_of_some_size_are_read(tmp_path: Path, name: str) -> None:
    """A pipe would be waited for without end, and a device or a sparse file fill the memory."""
    path = tmp_path / name
    os.mkfifo(path)
    if name == "commands.jsonl":
        with pytest.raises(InputError, match=f"{name}: cannot be read: it is not a regular file"):
            read_run_dir_files(tmp_path)
    else:
        read_run_dir_files(tmp_path)  # as if it were missing, which is a gap
    path.unlink()
    path.symlink_to("/dev/zero")
    if name == "commands.jsonl":
        with pytest.raises(InputError, match=f"{name}: cannot be read: it is not a regular file"):
            read_run_dir_files(tmp_path)
    path.unlink()
    with path.open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(InputError, match=f"{name}: cannot be read: it is larger than 256 MiB"):
        read_run_dir_files(tmp_path)


def test_a_summary_that_was_written_is_missed(run: Run) -> None:
    recordings, manifest, _ = run
    observer = recordings[-1]
    ended = replace(observer, metadata=replace(observer.metadata, has_summary=True))
    assert found(run, RunDirFiles()) == []
    verdict = verify([*recordings[:-1], ended], manifest, RunDirFiles())
    assert [(gap.kind, gap.of) for gap in verdict.gaps] == [(GapKind.SUMMARY, "summary.json")]
    killed = replace(ended, signatures=())
    gaps = verify([*recordings[:-1], killed], manifest, RunDirFiles()).gaps
    assert GapKind.SUMMARY not in [gap.kind for gap in gaps]


def test_a_missing_mission_is_noted(run: Run) -> None:
    files = replace(files_of(run, None, None), others=("run.json",))
    assert verify(*run[:2], files).notes == ()
    (note,) = verify(*run[:2], replace(files, missions={})).notes
    assert note.startswith("mission.json is missing")
