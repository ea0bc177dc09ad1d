"""Standard streams that cannot encode, are closed or full."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest

from mrbt_mesh.cli import terminal
from mrbt_mesh.cli.main import main
from mrbt_mesh.cli.streams import ERRORS, _prepared, prepare_streams
from mrbt_mesh.cli.views.marks import END_MARKS, LEVEL_MARKS, MARKS, STATE_MARKS
from tests.support.command import COURIERS, EXPLORE, REPAIR
from tests.support.paths import ROOT

ENCODINGS = ["latin-1", "ascii", "utf-8"]


class Streams:
    """Streams of an encoding in the place of the standard ones."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
        self.encoding = encoding
        self._bytes = io.BytesIO(), io.BytesIO()
        for name, data in zip(("stdout", "stderr"), self._bytes, strict=True):
            stream = _prepared(io.TextIOWrapper(data, encoding), loses=False)
            monkeypatch.setattr(sys, name, stream)

    def texts(self) -> list[str]:
        sys.stdout.flush()
        sys.stderr.flush()
        return [each.getvalue().decode(self.encoding) for each in self._bytes]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_every_way_to_print_takes_any_text(monkeypatch: pytest.MonkeyPatch, encoding: str) -> None:
    streams = Streams(monkeypatch, encoding)
    tables = (*MARKS.values(), *STATE_MARKS.values(), *END_MARKS.values(), *LEVEL_MARKS.values())
    signs = "".join(sign for sign, _ in tables) + "\u3042é\udce4"
    click.echo(signs)
    click.echo(signs, err=True)
    print(signs)  # noqa: T201
    terminal.console.print(signs)
    terminal.errors.print(signs)
    terminal.note(signs)
    terminal.print_done("ok", signs)
    terminal.print_json({signs: signs})
    output, problems = streams.texts()
    lines = output.splitlines()
    assert lines[0] == lines[1] == lines[2]
    assert (output.count("\\xe4"), problems.count("\\xe4")) == (4, 3)
    if encoding == "utf-8":
        assert "✔" in lines[0]
    else:
        assert "+" in lines[0]
        assert "\\u3042" in lines[0]
        assert ("é" in lines[0]) is (encoding == "latin-1")


def test_every_sign_that_is_drawn_in_a_terminal_has_a_plain_one() -> None:
    folders = ("cli", "views/terminal", "views/trees", "analysis/lift", "drills")
    files = [each for name in folders for each in (ROOT / "mrbt_mesh" / name).rglob("*.py")]
    signs = {sign for file in files for sign in file.read_text(encoding="utf-8") if ord(sign) > 127}
    assert {"✔", "⇉", "⧗"} <= signs
    plain = {sign: sign.encode("ascii", ERRORS).decode() for sign in signs}
    assert {sign for sign, found in plain.items() if len(found) != 1} == set()


@pytest.mark.parametrize("encoding", ENCODINGS[:2])
@pytest.mark.parametrize(
    "arguments",
    [
        ["tree", "show", EXPLORE],
        ["tree", "show", REPAIR, "--robot", "A1"],
        ["plan", REPAIR],
        ["plan", COURIERS],
        ["validate", REPAIR],
        ["--help"],
        ["sim", "run", EXPLORE],
        ["ls"],
        ["nonsense-\udce4"],
    ],
    ids=lambda arguments: " ".join(arguments[:2]).encode("ascii", "replace").decode(),
)
def test_commands_end_as_ever(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, encoding: str, arguments: list[str]
) -> None:
    monkeypatch.setenv("MRBT_STATE_DIR", str(tmp_path))
    streams = Streams(monkeypatch, encoding)
    with pytest.raises(SystemExit) as ended:
        main(args=arguments)
    assert ended.value.code == (2 if arguments[0].startswith("nonsense") else 0)
    assert any(streams.texts())


def ended(command: str, tmp_path: Path, **variables: str) -> subprocess.CompletedProcess[bytes]:
    """How a command of the shell ends, with `mrbt` as $MRBT."""
    environment = os.environ | {
        "MRBT": f"{sys.executable} -m mrbt_mesh",
        "MRBT_STATE_DIR": str(tmp_path),
        **variables,
    }
    return subprocess.run(
        ["sh", "-c", command], env=environment, capture_output=True, check=False, cwd=ROOT
    )


@pytest.mark.parametrize("command", [f"tree show {REPAIR}", f"plan {REPAIR}"])
def test_a_locale_that_lacks_signs_ends_no_command(tmp_path: Path, command: str) -> None:
    for encoding in ENCODINGS[:2]:
        found = ended(f"$MRBT {command}", tmp_path, PYTHONIOENCODING=encoding)
        assert (found.returncode, found.stderr) == (0, b"")
        assert found.stdout.decode(encoding)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has such a device")
def test_what_is_printed_to_a_full_disk_is_said_once(tmp_path: Path) -> None:
    for command in ("ls", "ls --json", "--version"):
        found = ended(f"$MRBT {command} > /dev/full", tmp_path)
        assert (found.returncode, found.stderr.decode()) == (
            1,
            "error: the output cannot be written: No space left on device\n",
        )
    assert ended("$MRBT ls > /dev/full 2>&1", tmp_path).returncode == 1


def test_a_closed_stream_loses_output_and_changes_nothing_else(tmp_path: Path) -> None:
    for closed in (">&-", "2>&-", "<&-", "<&- >&- 2>&-"):
        found = ended(f"$MRBT ls {closed}", tmp_path)
        assert (found.returncode, found.stderr) == (0, b""), closed
    assert ended("$MRBT nonsense >&- 2>&-", tmp_path).returncode == 2


SCRIPT = """
import os, sys
from mrbt_mesh.cli.streams import prepare_streams
prepare_streams()
with open(sys.argv[1], "w") as file:
    assert file.fileno() > 2
    os.write(1, b"lost"); print("lost"); sys.stdout.flush()
"""


def test_a_file_does_not_take_the_place_of_a_closed_stream(tmp_path: Path) -> None:
    file = tmp_path / "kept"
    command = [sys.executable, "-c", SCRIPT, str(file)]
    done = subprocess.run(["sh", "-c", '"$@" >&-', "sh", *command], cwd=ROOT, check=False)
    assert (done.returncode, file.read_text()) == (0, "")


def test_streams_are_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("stdin", "stdout", "stderr", "__stdin__", "__stdout__", "__stderr__"):
        monkeypatch.setattr(sys, name, io.TextIOWrapper(io.BytesIO(), "latin-1"))
    prepare_streams()
    first = sys.stdout
    prepare_streams()
    assert sys.stdout is first
