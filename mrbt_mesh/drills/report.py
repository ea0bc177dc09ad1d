"""The runs of drills for programs: JSON, and JUnit XML as CI systems read it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any
from xml.etree import ElementTree

from mrbt_mesh.drills.runner import DrillRun


def run_data(run: DrillRun) -> dict[str, Any]:
    """One run as plain data."""
    return {
        "drill": run.label,
        "transport": run.profile,
        "verdict": verdict_word(run),
        "result": run.result or None,
        "duration_s": round(run.duration_s, 3),
        "expectations": [asdict(verdict) for verdict in run.verdicts],
        "takeovers": run.takeovers,
        "timeline": [asdict(line) for line in run.timeline],
        "skipped": run.skipped,
        "run_dir": str(run.run_dir) if run.run_dir else None,
    }


def verdict_word(run: DrillRun) -> str:
    """green, red or skipped."""
    if run.skipped is not None:
        return "skipped"
    return "green" if run.is_green else "red"


def report_data(runs: Iterable[DrillRun]) -> dict[str, Any]:
    """All runs as plain data, with their counts."""
    listed = list(runs)
    words = [verdict_word(run) for run in listed]
    counts = {word: words.count(word) for word in ("green", "red", "skipped")}
    return counts | {"runs": [run_data(run) for run in listed]}


def junit_text(runs: Iterable[DrillRun]) -> str:
    """JUnit XML: one test case per run; what did not hold is a failure with all that was found."""
    listed = list(runs)
    words = [verdict_word(run) for run in listed]
    suite = ElementTree.Element(
        "testsuite",
        name="drills",
        tests=str(len(listed)),
        failures=str(words.count("red")),
        errors="0",
        skipped=str(words.count("skipped")),
        time=f"{sum(run.duration_s for run in listed):.3f}",
    )
    for run, word in zip(listed, words, strict=True):
        case = ElementTree.SubElement(
            suite,
            "testcase",
            classname=f"drills.{run.profile}",
            name=run.label,
            time=f"{run.duration_s:.3f}",
        )
        if word == "skipped":
            ElementTree.SubElement(case, "skipped", message=run.skipped or "")
            continue
        wrong = [verdict for verdict in run.verdicts if not verdict.holds]
        if wrong:
            message = "; ".join(f"{verdict.expected}: {verdict.found}" for verdict in wrong)
            failure = ElementTree.SubElement(case, "failure", message=message)
            failure.text = f"run directory: {run.run_dir}"
        output = ElementTree.SubElement(case, "system-out")
        output.text = "\n".join(
            f"{line.at_s:8.3f} {'! ' if line.is_fault else '  '}{line.robot:6} {line.text}"
            for line in run.timeline
        )
    suites = ElementTree.Element("testsuites")
    suites.append(suite)
    ElementTree.indent(suites)
    text = ElementTree.tostring(suites, encoding="unicode", xml_declaration=True)
    return text + "\n"
