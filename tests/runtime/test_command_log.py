"""commands.jsonl: signed line by line by the operator, each after the one before it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.runtime.command_log import check_signer, head_of, heads, note_command, noted_commands
from mrbt_mesh.runtime.key_folder import KeyFolder, KeysError
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.run_dir import COMMANDS_FILE, RunDir, RunDirError, RunInfo

RUN = "run1"


@pytest.fixture
def run_dir(tmp_path: Path) -> RunDir:
    """A run directory with the operator's key and three commands."""
    options = RobotOptions(team="t", run=RUN)
    info = RunInfo(
        mission_path="m.yaml",
        mission_name="m",
        options=options,
        endpoints={},
        dials={},
        started_unix_s=0.0,
        robots=("A",),
    )
    made = RunDir.create(tmp_path / "run", info, "{}")
    KeyFolder.create(made.keys_path, {"A": Role.ROBOT, "root": Role.OPERATOR})
    for number in range(3):
        note_command(made, "mrbt kill", f"A{number} killed")
    return made


def content_of(run_dir: RunDir) -> bytes:
    return (run_dir.path / COMMANDS_FILE).read_bytes()


def problems(run_dir: RunDir, content: bytes) -> list[str]:
    """What is not proved of each line."""
    noted = noted_commands(content, RUN, KeyFolder(run_dir.keys_path).manifest())
    return [each.problem or ("" if each.signer == "root" else "unsigned") for each in noted]


def test_what_was_noted_is_proved(run_dir: RunDir) -> None:
    content = content_of(run_dir)
    noted = list(noted_commands(content, RUN, KeyFolder(run_dir.keys_path).manifest()))
    assert [(each.by, each.command) for each in noted] == [
        ("mrbt kill", f"A{number} killed") for number in range(3)
    ]
    assert problems(run_dir, content) == ["", "", ""]
    assert head_of(content) == heads(content)[-1]
    assert len(heads(content)) == 4


def test_the_last_newline_belongs_to_its_line(run_dir: RunDir) -> None:
    assert problems(run_dir, content_of(run_dir)[:-1]) == ["", "", "lacks its newline"]


def test_every_change_of_a_line_is_named(run_dir: RunDir) -> None:
    content = content_of(run_dir)
    first, second, third = content.splitlines(keepends=True)
    assert any(problems(run_dir, first + third)), "a line taken out"
    assert any(problems(run_dir, second + third)), "the first line taken out"
    assert any(problems(run_dir, second + first + third)), "another order"
    assert any(problems(run_dir, first + first + second + third)), "a line doubled"
    assert any(problems(run_dir, first + b"\n" + second + third)), "an empty line"
    added = json.dumps({"unix_s": 1.0, "by": "mrbt kill", "command": "D2 killed"}).encode() + b"\n"
    assert any(problems(run_dir, content + added)), "a line added"
    data = json.loads(third)
    del data["signer"], data["signature"]
    unsigned = json.dumps(data).encode() + b"\n"
    assert problems(run_dir, first + second + unsigned)[-1] == "unsigned"
    for at in range(len(second)):
        changed = bytearray(second)
        changed[at] ^= 1
        assert any(problems(run_dir, first + bytes(changed) + third)), at
    other = list(noted_commands(content, "run2", KeyFolder(run_dir.keys_path).manifest()))
    assert all(each.problem for each in other), "of another run"


def test_a_line_that_was_cut_off_does_not_spoil_the_next(run_dir: RunDir) -> None:
    path = run_dir.path / COMMANDS_FILE
    with path.open("ab") as file:
        file.write(b'{"unix_s": 3')
    note_command(run_dir, "mrbt pause", "paused")
    assert problems(run_dir, content_of(run_dir)) == [
        *("", "", ""),
        "is not a command that mrbt has noted",
        "",
    ]


@pytest.mark.parametrize("unix_s", ["1e12", "-1e300", "1e18", "9" * 400, "NaN", "-1"])
def test_a_time_that_no_clock_shows_is_no_command_of_mrbt(unix_s: str) -> None:
    line = f'{{"unix_s": {unix_s}, "by": "a", "command": "b", "after": ""}}\n'.encode()
    (found,) = noted_commands(line, "run1", None)
    assert (found.unix_s, found.problem) == (None, "is not a command that mrbt has noted")


def test_a_robots_key_notes_nothing(run_dir: RunDir) -> None:
    """Its signature is no operator's."""
    (run_dir.keys_path / "root.key").unlink()
    note_command(run_dir, "mrbt pause", "paused")
    assert problems(run_dir, content_of(run_dir))[-1] == "unsigned"


def test_a_key_that_is_refused_signs_nothing_and_is_named_before(run_dir: RunDir) -> None:
    before, key = content_of(run_dir), run_dir.keys_path / "root.key"
    check_signer(run_dir)
    key.chmod(0o644)
    with pytest.raises(KeysError, match="chmod 600"):
        check_signer(run_dir)
    with pytest.raises(RunDirError, match="chmod 600"):
        note_command(run_dir, "mrbt pause", "paused")
    assert content_of(run_dir) == before
    key.unlink()
    check_signer(run_dir)


def test_a_command_that_cannot_be_noted_is_an_error(run_dir: RunDir) -> None:
    path = run_dir.path / COMMANDS_FILE
    path.unlink()
    path.mkdir()
    with pytest.raises(RunDirError, match=r"the command is not noted for reports: Is a"):
        note_command(run_dir, "mrbt kill", "A1 killed")


def test_other_line_ends_are_a_change(run_dir: RunDir) -> None:
    """What is signed are the bytes."""
    content = content_of(run_dir)
    changed = content.replace(b"\n", b"\r\n")
    assert problems(run_dir, changed) == ["is not as mrbt writes it"] * 3
    assert head_of(changed) not in heads(content)
    other = content.replace(b"\n", b"\r")
    assert problems(run_dir, other) == ["is not a command that mrbt has noted"]
