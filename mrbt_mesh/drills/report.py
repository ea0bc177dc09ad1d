"""The runs of drills for programs: JSON, and JUnit XML for CI systems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any
from xml.etree import ElementTree

from mrbt_mesh.drills.runner import DrillRun


def run_data(run: DrillRun) -> dict[str, Any]:
    """Return one run as plain data."""
    return {
        "drill": run.label,
        "transport": run.profile,
        "color": run.color,
        "result": run.result or None,
        "duration_s": round(run.duration_s, 3),
        "expectations": [asdict(result) for result in run.results],
        "takeovers": run.takeovers,
        "timeline": [asdict(line) for line in run.timeline],
        "skipped": run.skipped,
        "run_dir": str(run.run_dir) if run.run_dir else None,
    }


def report_data(runs: Sequence[DrillRun]) -> dict[str, Any]:
    """Return all runs as plain data, with their counts."""
    colors = Counter(run.color for run in runs)
    counts = {color: colors[color] for color in ("green", "red", "skipped")}
    return counts | {"runs": [run_data(run) for run in runs]}


def junit_text(runs: Sequence[DrillRun]) -> str:
    """Return JUnit XML: a test case per run; a failure lists the expectations that did not hold."""
    colors = Counter(run.color for run in runs)
    suites = ElementTree.Element("testsuites")
    suite = ElementTree.SubElement(
        suites,
        "testsuite",
        name="drills",
        tests=str(len(runs)),
        failures=str(colors["red"]),
        errors="0",
        skipped=str(colors["skipped"]),
        time=f"{sum(run.duration_s for run in runs):.3f}",
    )
    for run in runs:
        case = ElementTree.SubElement(
            suite,
            "testcase",
            classname=f"drills.{run.profile}",
            name=run.label,
            time=f"{run.duration_s:.3f}",
        )
        if run.skipped is not None:
            ElementTree.SubElement(case, "skipped", message=run.skipped)
            continue
        if not run.is_green:
            wrong = [result for result in run.results if not result.holds]
            message = "; ".join(f"{result.expected}: {result.found}" for result in wrong)
            failure = ElementTree.SubElement(case, "failure", message=message)
            failure.text = f"run directory: {run.run_dir}"
        output = ElementTree.SubElement(case, "system-out")
        output.text = "\n".join(
            f"{line.at_s:8.3f} {'! ' if line.is_fault else '  '}{line.robot:6} {line.text}"
            for line in run.timeline
        )
    ElementTree.indent(suites)
    text = ElementTree.tostring(suites, encoding="unicode", xml_declaration=True)
    return text + "\n"
