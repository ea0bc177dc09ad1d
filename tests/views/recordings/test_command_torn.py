"""A recording whose end a power cut has torn: every command reads it up to there, and says so."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.support.command import EXPLORE, done, mrbt, refused

TORN = "bytes are no whole record"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`run`, and `torn`: the same with a torn observer's recording, and one that was only begun."""
    made = tmp_path_factory.mktemp("torn")
    code, _, problems = mrbt("sim", "run", EXPLORE, "--seed", "3", "--record", str(made / "run"))
    assert (code, problems) == (0, "")
    shutil.copytree(made / "run", made / "torn")
    content = (made / "run" / "run.mcap").read_bytes()
    cut = content.rindex(b'"check"') - 5
    (made / "torn" / "run.mcap").write_bytes(content[:cut] + bytes(8_192))
    (made / "torn" / "recordings" / "R1.2.mcap").write_bytes(bytes(4_096))
    return made


def recording(*arguments: str) -> tuple[int, str, str]:
    return mrbt("recording", *arguments)


def test_replay(folder: Path) -> None:
    file = str(folder / "torn" / "run.mcap")
    assert TORN in done(recording("replay", file))
    assert TORN in json.loads(done(recording("replay", file, "--json")))["torn"]


def test_report(folder: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    done(recording("report", str(folder / "torn"), "-o", str(page)))
    assert "Note: run.mcap: its last" in page.read_text()


def test_what_if(folder: Path) -> None:
    code, output, _ = recording("what-if", str(folder / "torn" / "run.mcap"), "--at", "2")
    assert code == 0
    assert TORN in " ".join(output.split())


def test_verify_reads_what_is_there_and_names_what_is_not(folder: Path) -> None:
    code, output, _ = recording("verify", str(folder / "torn"), "--accept", "unsigned", "--json")
    data = json.loads(output)
    assert code == 1
    assert data["findings"] == []
    texts = [each["text"] for each in data["not_proved"] if each["kind"] == "end"]
    assert len(texts) == 1
    assert TORN in texts[0]
    assert "R1.2.mcap: holds nothing" in data["notes"][0]


def test_a_change_within_is_refused_by_all_but_verify(folder: Path, tmp_path: Path) -> None:
    content = bytearray((folder / "run" / "run.mcap").read_bytes())
    at = content.index(b'"check"') - 3
    content[at] ^= 1
    path = tmp_path / "run.mcap"
    path.write_bytes(bytes(content))
    for words in (("replay", str(path)), ("what-if", str(path), "--at", "2")):
        assert "see `mrbt recording verify`" in refused(recording(*words))
    assert recording("verify", str(path))[0] == 1
