"""What programs read of drills: JSON and JUnit XML."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

from mrbt_mesh.drills.judge import DrillResult
from mrbt_mesh.drills.report import junit_text, report_data
from mrbt_mesh.drills.runner import DrillRun, TimelineEntry

GREEN = DrillRun(
    "storm",
    "wired",
    "success",
    2.5,
    [DrillResult("result success", True, "success")],
    [
        TimelineEntry(0.25, "A1", "killed (SIGKILL)", is_fault=True),
        TimelineEntry(0.5, "A1", "is dead"),
    ],
    [{"robot": "A1", "detected_s": 0.25}],
)
RED = DrillRun(
    "cut[robot=<A1>]",
    "wireless",
    "timeout",
    60.0,
    [
        DrillResult("result success", False, "timeout"),
        DrillResult("all faults carried out", True, "yes"),
        DrillResult("nothing repeated", False, "lift by A1 & B1"),
    ],
    run_dir=Path("/runs/7"),
)
SKIPPED = DrillRun("cut", "wired", skipped="network namespaces need root")


def test_json_counts_and_tells_all() -> None:
    data = json.loads(json.dumps(report_data([GREEN, RED, SKIPPED])))
    assert (data["green"], data["red"], data["skipped"]) == (1, 1, 1)
    green, red, skipped = data["runs"]
    assert [run["color"] for run in data["runs"]] == ["green", "red", "skipped"]
    assert green["takeovers"] == [{"robot": "A1", "detected_s": 0.25}]
    assert green["timeline"][0] == {
        "at_s": 0.25,
        "robot": "A1",
        "text": "killed (SIGKILL)",
        "is_fault": True,
    }
    assert red["expectations"][2] == {
        "expected": "nothing repeated",
        "holds": False,
        "found": "lift by A1 & B1",
    }
    assert red["run_dir"] == "/runs/7"
    assert skipped["skipped"] == "network namespaces need root"
    assert skipped["result"] is None


def test_junit_has_a_case_per_run_with_its_reasons() -> None:
    suites = ElementTree.fromstring(junit_text([GREEN, RED, SKIPPED]))
    (suite,) = suites
    counts = {name: suite.get(name) for name in ("tests", "failures", "errors", "skipped")}
    assert counts == {"tests": "3", "failures": "1", "errors": "0", "skipped": "1"}
    assert suite.get("time") == "62.500"
    green, red, skipped = suite
    assert (green.get("classname"), green.get("name")) == ("drills.wired", "storm")
    assert [part.tag for part in green] == ["system-out"]
    assert "0.250 ! A1     killed (SIGKILL)" in (green[0].text or "")
    assert red.get("name") == "cut[robot=<A1>]"
    assert red[0].tag == "failure"
    assert red[0].get("message") == "result success: timeout; nothing repeated: lift by A1 & B1"
    assert red[0].text == "run directory: /runs/7"
    assert [part.tag for part in skipped] == ["skipped"]
    assert skipped[0].get("message") == "network namespaces need root"
