"""mrbt recording report, on runs of mrbt sim run --record and on what commands told."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.support.command import EXPLORE, done, mrbt, refused


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
    output = done(recording("report", str(folder / "run"), str(folder / "sim.json"), "--json"))
    recorded, told = json.loads(output)["runs"]
    summary = json.loads((folder / "sim.json").read_text())
    assert recorded["result"] == told["result"] == summary["result"]
    assert (recorded["title"], told["title"]) == ("run", "sim")
    assert recorded["detected_us"] == told["detected_us"]
    (takeover,) = summary["takeovers"]
    assert recorded["detected_us"]["most"] == round(1e6 * takeover["detected_s"])
    assert 0 < recorded["utilisation"] <= 1
    assert told["work"] is None


def test_runs_are_compared(folder: Path) -> None:
    page = folder / "both.html"
    given = (str(folder / "run"), str(folder / "run" / "run.mcap"))
    assert recording("report", *given, "-o", str(page))[0] == 0
    text = page.read_text()
    assert "<h1>2 runs</h1>" in text
    assert "<h1>run</h1>" in text
    assert "<h1>run (2)</h1>" in text


def test_drills_and_chaos(folder: Path) -> None:
    takeover = {"robot": "R1", "at_s": 1, "detected_s": 0.2, "reassigned_s": 0.3}
    run = {
        "drill": "a<b>",
        "transport": "direct",
        "color": "green",
        "result": "success",
        "duration_s": 2.0,
        "skipped": None,
        "run_dir": str(folder / "run"),
        "expectations": [{"expected": "ends", "holds": True, "found": "<script>"}],
        "takeovers": [{**takeover, "held": "scan", "replacement": "R2", "exact": True}],
    }
    gone = {**run, "run_dir": None, "color": "red"}
    (folder / "drills.json").write_text(json.dumps({"green": 1, "runs": [run, gone]}))
    chaos = {"seeds": 2, "took_s": 1, "results": {}, "checks": {"I1": 3}, "failures": []}
    (folder / "chaos.json").write_text(json.dumps(chaos))
    page = folder / "all.html"
    given = (str(folder / "drills.json"), str(folder / "chaos.json"))
    assert recording("report", *given, "-o", str(page))[0] == 0
    text = page.read_text()
    assert "a&lt;b&gt; (direct)" in text
    assert "&lt;script&gt;" in text
    assert "<script" not in text
    assert text.count("<svg") == 1, "only one of both has its recording still"
    assert "no invariant broken" in text
    assert "all robots agreed on" in text, "a drill's too, where its recording is still there"
    assert text.count("<h2>Agreement") == 1


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("{", "is neither a recording (.mcap) nor JSON"),
        ("[]", "is not what `mrbt sim run"),
        ("{}", "is not what `mrbt sim run"),
        ('{"green": 1, "runs": [3]}', "is not what `mrbt sim run"),
        ('{"seeds": 1, "checks": 3}', "is not what `mrbt sim run"),
        ('{"duration_s": NaN}', "is neither a recording (.mcap) nor JSON"),
        ('{"mission": "\\ud800"}', "is neither a recording (.mcap) nor JSON"),
    ],
)
def test_what_is_no_finding_ends_with_status_2(tmp_path: Path, content: str, problem: str) -> None:
    path = tmp_path / "told.json"
    path.write_text(content)
    problems = refused(recording("report", str(path)))
    assert "told.json" in problems
    assert problem in " ".join(problems.split())


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
            ("run, run.2.mcap", "timeout"),
        ]


def test_what_cannot_be_read_or_written_ends_with_status_2(folder: Path, tmp_path: Path) -> None:
    for given, problem in (
        ([str(tmp_path)], "holds neither recordings nor summary.json"),
        ([str(tmp_path / "none.json")], "cannot be read"),
        ([str(folder / "run"), "-o", str(tmp_path / "no" / "report.html")], "there is no folder"),
    ):
        assert problem in " ".join(refused(recording("report", *given)).split())
