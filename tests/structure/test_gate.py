"""The gate tries what the documents say, and leaves no test out."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections import Counter
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.support import gate
from tests.support.paths import ROOT

# What the gate tries at least: less of it has let bugs through.
LEAST = {"CHAOS_SEEDS": 100, "EXAMPLES": 50}
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
LOOK = """
import json
from tests.support import effort
from tests.sim import test_chaos
blocks = test_chaos.test_no_invariant_breaks_on_generated_missions.pytestmark[0].args[1]
print(json.dumps({
    "CHAOS_SEEDS": effort.CHAOS_SEEDS,
    "EXAMPLES": effort.EXAMPLES,
    "seeds": len(effort.seeds(8)),
    "blocks": [len(range(first, first + effort.CHAOS_BLOCK)) for first in blocks],
    "of_examples": {name: len(test_chaos.example_seeds(name)) for name in test_chaos.EXAMPLE_SEEDS},
    "invariants": sorted(test_chaos.ALL),
}))
"""


@cache
def sizes(size: str) -> dict[str, Any]:
    """The figures of a size, as tests see them."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("MRBT_")}
    done = subprocess.run(
        [sys.executable, "-c", LOOK],
        cwd=ROOT,
        env=kept | {"MRBT_TESTS": size, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_the_gate_tries_no_less_than_it_did() -> None:
    found = sizes("gate")
    assert all(found[name] >= least for name, least in LEAST.items()), found
    assert found["seeds"] == 8, "all seeds of a test"
    assert sum(found["blocks"]) == found["CHAOS_SEEDS"]
    assert all(found["of_examples"].values()), found
    assert len(set(found["of_examples"].values())) > 1, "shares of the seeds, not one for each"
    assert found["invariants"] == sorted(f"I{i}" for i in [*range(1, 14)])


def test_quick_runs_check_a_whole_block_of_chaos() -> None:
    found = sizes("quick")
    assert sum(found["blocks"]) == found["CHAOS_SEEDS"] >= 20
    assert found["seeds"] == 1


def test_the_document_names_these_figures() -> None:
    seeds, examples = re.findall(r"(\d+) seeds of chaos and (\d+) examples", CONTRIBUTING)[0]
    found = sizes("gate")
    assert (int(seeds), int(examples)) == (found["CHAOS_SEEDS"], found["EXAMPLES"])


def test_continuous_integration_runs_both() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert [line for line in script.splitlines() if line.startswith("make")] == [
        *("make test", "make gate")
    ]
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\ngate:")[2]
    assert "-m tests.support.gate" in recipe.partition("\n\n")[0]


def test_every_folder_with_tests_of_its_own_is_in_a_suite() -> None:
    words = {word for suite in gate.SUITES for word in suite.arguments}
    for folder in ("browser", "docker", "environments", "processes"):
        assert f"tests/{folder}" in words
    assert {suite.name for suite in gate.SUITES if suite.environment} == {"plain"}
    assert gate.SIZE == {"MRBT_TESTS": "gate"}


# -- the gate itself --------------------------------------------------------------------------

REPORT = """<testsuites><testsuite>
<testcase classname="tests.a.test_b" name="test_c[0]"/>
<testcase classname="tests.a.test_b" name="test_d"><skipped message="no Chromium"/></testcase>
<testcase classname="tests.a.test_b" name="test_e"><failure message="x"/></testcase>
</testsuite></testsuites>"""


def test_what_a_report_tells() -> None:
    outcome = gate.Outcome()
    gate.read_report(REPORT, outcome)
    assert outcome.ran == {"tests.a.test_b::test_c[0]", "tests.a.test_b::test_e"}
    assert outcome.skipped == {"tests.a.test_b::test_d"}
    assert outcome.reasons == {"no Chromium": 1}
    assert (
        gate.name_of("tests/a/test_b.py::test_c[d::e.py/f]") == "tests.a.test_b::test_c[d::e.py/f]"
    )
    assert gate.name_of("tests/a/test_b.py::TestC::test_d[0]") == "tests.a.test_b.TestC::test_d[0]"


def outcome(status: int = 0, **reasons: int) -> gate.Outcome:
    return gate.Outcome(status, 61.7, {"a::b", "a::c"}, {"a::d"}, Counter(reasons))


def test_the_end_of_a_gate_that_passes() -> None:
    lines, is_well = gate.summary({"some": outcome(chromium=1)}, {"a::b", "a::c", "a::d"})
    assert is_well
    assert lines[1:3] == ["skipped, and why:", "     1 chromium"]
    assert lines[-3].split() == ["some", "2", "1", "62"]
    assert lines[-1] == "passed: 2 tests, 1 skipped"


def test_a_test_that_no_suite_runs_fails_the_gate() -> None:
    lines, is_well = gate.summary({"some": outcome()}, {"a::b", "a::left_out"})
    assert not is_well
    assert "no suite has run a::left_out" in lines
    assert lines[-1].startswith("FAILED")


def test_a_suite_that_fails_fails_the_gate() -> None:
    lines, is_well = gate.summary({"some": outcome(), "other": outcome(1)}, set())
    assert not is_well
    assert lines[-3].endswith("FAILED")
    assert not lines[-4].endswith("FAILED")


@pytest.mark.slow
def test_suites_are_run_and_compared_with_what_there_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good = "import pytest\n\ndef test_runs(): pass\n\n@pytest.mark.skip('cannot be had')\n"
    (tmp_path / "test_good.py").write_text(f"{good}def test_is_skipped(): pass\n")
    (tmp_path / "test_bad.py").write_text("def test_bad(): assert 1 + 1 == 3\n")
    (tmp_path / "test_left_out.py").write_text("def test_it(): pass\n")
    monkeypatch.setattr(gate, "ROOT", tmp_path)
    monkeypatch.setattr(gate, "OUTPUT", tmp_path / "out")
    lanes = {name: gate.Suite(name, name, (f"test_{name}.py",)) for name in ("good", "bad")}
    monkeypatch.setattr(gate, "SUITES", tuple(lanes.values()))
    monkeypatch.setattr(gate, "BEYOND_QUICK", ())
    assert gate.main(()) == 1
    said = capsys.readouterr().out
    assert "assert (1 + 1) == 3" in said
    assert "     1 cannot be had\nno suite has run test_left_out::test_it\n" in said
    assert re.search(r"^good +1 +1 +\d+$", said, re.MULTILINE)
    assert re.search(r"^bad +1 +0 +\d+   FAILED$", said, re.MULTILINE)
    assert said.endswith("FAILED: 2 tests, 1 skipped\n")
