"""mrbt recording report, on runs of mrbt sim run --record."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.recording.metadata import OBSERVER
from mrbt_mesh.runtime.key_folder import KeyFolder
from mrbt_mesh.sim import AgentOptions
from tests.support.command import EXPLORE, done, mrbt, refused
from tests.support.recorded import record_example


def recording(*arguments: str) -> tuple[int, str, str]:
    return mrbt("recording", *arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`run`, a run directory, and `sim.json`, what was told of it."""
    made = tmp_path_factory.mktemp("reports")
    code, output, _ = mrbt(
        *(
            "sim",
            "run",
            EXPLORE,
            "--seed",
            "3",
            "--kill",
            "R1@3",
            "--record",
            str(made / "run"),
            "--json",
        )
    )
    assert code in (0, 3)
    (made / "sim.json").write_text(output)
    return made


def test_a_page_is_one_file_that_needs_nothing(folder: Path) -> None:
    page = folder / "report.html"
    assert recording("report", str(folder / "run"), "-o", str(page)) == (
        0,
        f"wrote {page}\n",
        "",
    )
    text = page.read_text()
    for unwanted in ("<script", "http:", "https:", "src=", "@import", "url("):
        assert unwanted not in text
    for wanted in ("Who did what when", "R1 died at", "prefers-color-scheme: dark", "@media print"):
        assert wanted in text
    chart = text[text.index("<svg") : text.index("</svg>") + 6]
    ElementTree.fromstring(chart)


def test_the_figures_as_json_are_those_of_the_summary(folder: Path) -> None:
    alone = folder / "alone"
    alone.mkdir()
    shutil.copy(folder / "run" / "summary.json", alone)
    (recorded,), (told,) = (
        json.loads(done(recording("report", str(each), "--json")))["runs"]
        for each in (folder / "run", alone)
    )
    summary = json.loads((folder / "sim.json").read_text())
    assert recorded["result"] == told["result"] == summary["result"]
    assert (recorded["title"], told["title"]) == ("run", "alone")
    assert recorded["detected_us"] == told["detected_us"]
    (takeover,) = summary["takeovers"]
    assert recorded["detected_us"]["most"] == round(1e6 * takeover["detected_s"])
    assert 0 < recorded["utilisation"] <= 1
    assert told["work"] is None


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", "is not JSON"),
        ("[]", "is not a summary of a run"),
        ("{}", "is not a summary of a run"),
        ('{"duration_s": NaN}', "is not JSON"),
        ('{"mission": "\\ud800"}', "is not JSON"),
    ],
)
def test_what_is_no_summary_ends_with_status_2(tmp_path: Path, content: str, problem: str) -> None:
    (tmp_path / "summary.json").write_text(content)
    problems = " ".join(refused(recording("report", str(tmp_path))).split())
    assert "summary.json" in problems
    assert problem in problems


def test_a_page_takes_the_place_of_a_page_alone(folder: Path, tmp_path: Path) -> None:
    """Evidence is not overwritten by a slip of the hand, nor through a link."""
    page, evidence = tmp_path / "report.html", tmp_path / "summary.json"
    for _ in range(2):
        done(recording("report", str(folder / "run"), "-o", str(page)))
    evidence.write_bytes((folder / "run" / "summary.json").read_bytes())
    link = tmp_path / "link.html"
    link.symlink_to(evidence)
    for output in (evidence, link):
        problems = " ".join(refused(recording("report", str(tmp_path), "-o", str(output))).split())
        assert "is there, and is not a page of a report: name another file" in problems
    assert evidence.read_bytes() == (folder / "run" / "summary.json").read_bytes()


def test_of_one_run_alone(folder: Path) -> None:
    both = (str(folder / "run"), str(folder / "run" / "run.mcap"))
    assert "run.mcap" in refused(recording("report", *both))
    assert "is not an mrbt recording" in " ".join(
        refused(recording("report", str(folder / "sim.json"))).split()
    )


def test_each_part_of_a_run_that_was_continued_is_reported(folder: Path, tmp_path: Path) -> None:
    """In their order, whatever the times of the files are: they may have been copied."""
    run = tmp_path / "run"
    shutil.copytree(folder / "run", run)
    (run / "summary.json").unlink()
    first = (run / "run.mcap").read_bytes()
    (run / "run.2.mcap").write_bytes(first[: len(first) // 2])
    for newest in ("run.mcap", "run.2.mcap"):
        os.utime(run / newest)
        runs = json.loads(recording("report", str(run), "--json")[1])["runs"]
        assert [(each["title"], each["result"]) for each in runs] == [
            ("run, run.mcap", "success"),
            ("run, run.2.mcap", "not known"),
        ]


def test_what_cannot_be_read_or_written_ends_with_status_2(folder: Path, tmp_path: Path) -> None:
    for given, problem in (
        ([str(tmp_path)], "holds neither recordings nor summary.json"),
        ([str(tmp_path / "none.mcap")], "cannot be read"),
        ([str(folder / "run"), "-o", str(tmp_path / "no" / "report.html")], "there is no folder"),
    ):
        assert problem in " ".join(refused(recording("report", *given)).split())


def test_a_file_of_a_team_with_keys_is_reported_with_its_keys(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    members = {"R1": Role.ROBOT, "R2": Role.ROBOT, "eye": Role.OBSERVER}
    folder = KeyFolder.create(keys, members)
    signers = {name: folder.keys_of(name) for name in members}
    options = AgentOptions(keys={**signers, OBSERVER: signers["eye"]})
    record_example(tmp_path / "run", "explore", 3, options=options)
    file = str(tmp_path / "run" / "run.mcap")

    def gaps(*arguments: str) -> str:
        told = json.loads(done(recording("report", file, "--json", *arguments)))
        return " ".join(told["runs"][0]["proof"]["gaps"])

    assert "give --keys, a folder with the team's manifest" in gaps()
    assert "--keys" not in gaps("--keys", str(keys))
