"""`python -m benchmarks`: what it lists, runs, writes and refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import __main__ as entry
from benchmarks import auction, registry, report
from benchmarks.instances import Density, Spec, Values, draw
from benchmarks.registry import MODULES, Benchmark, Result, Setting, Table, load
from benchmarks.report import ROOT
from tests.support.effort import at_size

PROGRAMS = (
    *("failover", "membership", "metrics", "recording", "resume", "robustness"),
    *("scale", "scale.raw", "security", "tokens"),
)

RESULT = Result(
    "nothing",
    [{"robots": 6, "time_ms": 1.5}],
    [Table("Times", ("robots", "ms"), [("6", "1.5"), ("50", "8")])],
    ["A note."],
)


@pytest.fixture
def example(monkeypatch: pytest.MonkeyPatch) -> list[Setting]:
    """The only benchmark is an example; returns the settings that it is run with."""
    seen: list[Setting] = []

    def run(setting: Setting) -> Result:
        seen.append(setting)
        return RESULT

    monkeypatch.setattr(entry, "MODULES", ("example",))
    monkeypatch.setattr(entry, "load", lambda name: {"example": Benchmark("an example", run)}[name])
    return seen


def test_every_benchmark_has_its_module_and_place_in_the_document() -> None:
    document = entry.DOCUMENT.read_text(encoding="utf-8")
    for name in MODULES:
        assert load(name).summary
        assert all(document.count(mark) == 1 for mark in report.marks(name)), name


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert entry.main(["--list"]) == 0
    text = capsys.readouterr().out
    for name in MODULES:
        assert f"\n{name} " in f"\n{text}"


def test_json_and_table(
    example: list[Setting], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "found.json"
    assert entry.main(["--quick", "--seed", "5", "--json", str(file)]) == 0
    assert [(each.quick, each.seed) for each in example] == [(True, 5)]
    found = json.loads(file.read_text())
    assert (found["format"], found["seed"], found["quick"]) == (entry.FORMAT, 5, True)
    assert {"machine", "versions", "load_before"} < found.keys()
    assert "ortools" in found["versions"]
    assert found["results"]["example"]["rows"] == RESULT.rows
    assert found["results"]["example"]["reference"] == "nothing"
    shown = capsys.readouterr().out
    assert "robots" in shown
    assert "A note." in shown


def test_documents(example: list[Setting], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = tmp_path / "performance.md"
    marks = "\nold\n".join(report.marks("example"))
    document.write_text(f"# Before\n\n{marks}\n\nafter\n")
    monkeypatch.setattr(entry, "DOCUMENT", document)
    assert entry.main(["--write-docs"]) == 0
    text = document.read_text()
    assert "old" not in text
    assert "| 6 | 1.5 |\n| 50 | 8 |\n\nA note.\n\n<!-- measured" in text
    assert text.startswith("# Before\n")
    assert text.endswith("-->\n\nafter\n")
    entry.main(["--write-docs"])
    assert document.read_text() == text
    document.write_text("no place")
    example.clear()
    with pytest.raises(SystemExit) as ended:
        entry.main(["--write-docs"])
    assert (ended.value.code, example) == (2, []), "refused before anything is measured"


@pytest.mark.parametrize(
    "text",
    ["", report.marks("a")[0], " ".join(reversed(report.marks("a"))), " ".join(report.marks())],
)
def test_a_document_without_its_place_is_left_alone(tmp_path: Path, text: str) -> None:
    document = tmp_path / "page.md"
    document.write_text(text)
    with pytest.raises(ValueError, match=r"page\.md has no place .* <!-- measured a: begin -->"):
        report.write_docs(document, "new", "a")
    assert document.read_text() == text


def test_a_row_that_does_not_fit_its_table() -> None:
    with pytest.raises(ValueError, match="1 cells under 2 headings"):
        Table("", ("a", "b"), [("x",)])


def test_a_missing_package_ends_in_status_2_and_a_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def run(setting: Setting) -> Result:
        registry.need("no_such_package")
        return RESULT

    monkeypatch.setattr(entry, "MODULES", ("lacking", "whole"))
    others = {"lacking": Benchmark("", run), "whole": Benchmark("", lambda _: RESULT)}
    monkeypatch.setattr(entry, "load", lambda name: others[name])
    file = tmp_path / "found.json"
    assert entry.main(["--json", str(file)]) == 2
    assert "lacking: needs no_such_package: pip install" in capsys.readouterr().err
    assert list(json.loads(file.read_text())["results"]) == ["whole"]


def test_unknown_names_and_folders_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for wrong, why in ((["--only", "nothing"], "nothing"), (["--json", "no/such/file"], "folder")):
        with pytest.raises(SystemExit) as ended:
            entry.main(wrong)
        assert ended.value.code == 2
        assert why in capsys.readouterr().err


@pytest.mark.parametrize("name", at_size(quick=PROGRAMS[::4], gate=PROGRAMS))
def test_every_program_shows_its_options(name: str) -> None:
    command = [sys.executable, "-m", f"benchmarks.{name}", "--help"]
    assert "--json" in subprocess.run(command, cwd=ROOT, check=True, stdout=-1, text=True).stdout


def test_a_program_prints_its_figures_and_updates_its_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page, file = tmp_path / "page.md", tmp_path / "found.json"
    page.write_text("\n".join(report.marks("a")))

    def measure(runs: int = 3, sizes: tuple[int, ...] = (1,), full: bool = False) -> dict[str, Any]:
        return {"total": runs * sum(sizes) + full, "tables": {"a": "| x |"}}

    options = ["--runs", "2", "--sizes", "4", "5", "--full", "--write-docs", "--json"]
    monkeypatch.setattr(sys, "argv", ["bench", *options, str(file)])
    found = report.run_program("", measure, page)
    assert (found["total"], found["options"]["sizes"]) == (19, [4, 5])
    assert json.loads(file.read_text()) == found
    assert capsys.readouterr().out == "| x |\n"
    assert "| x |" in page.read_text()
    monkeypatch.setattr(sys, "argv", ["bench", "--runs", "0"])
    with pytest.raises(SystemExit):
        report.run_program("", measure)
    assert "--runs: a number from 1 is expected, not 0" in capsys.readouterr().err


def test_the_exact_way_is_the_measure_of_the_auctions() -> None:
    spec = {"robots": 6, "density": Density.SPARSE, "values": Values.WIDE}
    found = auction.measure(spec, range(5), 1.0, "complete", tuple(auction.LABELS))
    for seed, exact in enumerate(found[auction.EXACT]):
        assert (exact.rounds, exact.messages) == (1, 30), f"seed {seed}"
        assert (exact.score, exact.usable, exact.missed) == (1.0, 1.0, 0), f"seed {seed}"
    for way in (auction.WITH_BONUS, auction.PLAIN):
        for seed, figures in enumerate(found[way]):
            assert figures.messages == figures.rounds * 30, f"{way}, seed {seed}"
            assert figures.usable <= figures.score, f"{way}, seed {seed}"
            assert figures.score <= 1.0 or figures.missed, f"{way}, seed {seed}"
    summary = auction.summary(found[auction.PLAIN])
    assert summary["missed_mean"] == sum(f.missed for f in found[auction.PLAIN]) / 5
    assert summary["score_min"] == min(f.score for f in found[auction.PLAIN])
    exact = auction.summary(found[auction.EXACT])
    of_way = {auction.EXACT: exact, auction.WITH_BONUS: exact, auction.PLAIN: summary}
    assert len(auction.cells(of_way)) == len(auction.HEAD)


def test_a_broadcast_says_what_the_robot_can_do() -> None:
    instance = draw(Spec(3, 1, Density.DENSE, Values.EQUAL, 1))
    assert instance.demands == 1
    assert auction.record_bytes(instance).tolist() == [1 + 2 + 2] * 3
