"""`python -m benchmarks`: what it lists, runs, writes and refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import __main__ as entry
from benchmarks import auction, registry, report
from benchmarks.instances import Density, Spec, Values, draw
from benchmarks.registry import (
    MODULES,
    SCRIPTS,
    Benchmark,
    Chart,
    MissingPackageError,
    Result,
    Script,
    Setting,
    Table,
    load,
)
from benchmarks.run import ROOT

RESULT = Result(
    "nothing",
    [{"robots": 6, "time_ms": 1.5}],
    [Table("Times", ("robots", "ms"), [("6", "1.5"), ("50", "8")])],
    [Chart("times", "Times", "robots", "ms", {"a": [(6, 1.5), (50, 8)], "b": [(6, 2)]})],
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


@pytest.mark.parametrize("name", SCRIPTS)
def test_every_script_knows_the_options_it_is_run_with(name: str) -> None:
    command = [sys.executable, "-m", f"benchmarks.{name}", "--help"]
    text = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    script = SCRIPTS[name]
    for option in ("--json", *script.options, *script.quick_options):
        assert not option.startswith("--") or option in text


def test_list(capsys: pytest.CaptureFixture[str]) -> None:
    assert entry.main(["--list"]) == 0
    text = capsys.readouterr().out
    for name in (*MODULES, *SCRIPTS):
        assert f"\n{name} " in f"\n{text}"


def test_json_table_and_plot(
    example: list[Setting], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder = tmp_path / "found.json", tmp_path / "plots"
    options = ["--quick", "--seed", "5", "--json", str(file), "--plot", str(folder)]
    assert entry.main(options) == 0
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
    assert (folder / "times.png").read_bytes().startswith(b"\x89PNG")


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


def test_plot_without_matplotlib(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    from benchmarks.plots import draw as draw_charts

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingPackageError, match=r"pip install -e '\.\[plot\]'"):
        draw_charts(RESULT.charts, tmp_path)


def test_unknown_names_and_folders_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for wrong, why in ((["--only", "nothing"], "nothing"), (["--json", "no/such/file"], "folder")):
        with pytest.raises(SystemExit) as ended:
            entry.main(wrong)
        assert ended.value.code == 2
        assert why in capsys.readouterr().err


def test_a_script_runs_as_a_process_and_its_json_is_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(entry, "SCRIPTS", {"estimate": Script("", (), ("--runs", "1"))})
    file = tmp_path / "found.json"
    assert entry.main(["--only", "estimate", "--quick", "--json", str(file)]) == 0
    assert json.loads(file.read_text())["results"]["estimate"]["runs"] == 1


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
    assert len(auction.cells(exact, exact, summary)) == len(auction.HEAD)


def test_a_broadcast_says_what_the_robot_can_do() -> None:
    instance = draw(Spec(3, 1, Density.DENSE, Values.EQUAL, 1))
    assert instance.demands == 1
    assert auction.record_bytes(instance).tolist() == [1 + 2 + 2] * 3
