"""The figures of what `mrbt sim`, `up`, `drill` and `chaos` tell with --json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.replay.report.model import (
    CampaignReport,
    Expectation,
    ReportedFault,
    RobotUse,
    RunReport,
    TaskEnd,
    milliseconds,
)

NO_RECORDING = "from a summary: who worked when, and who waited, is in the run's recording"


def report_summary(told: Mapping[str, Any], title: str) -> RunReport:
    """A run's summary; raises KeyError, TypeError or ValueError for what is none."""
    minor = [
        ReportedFault(
            each["robot"], float(each["at_s"] or 0), each["until_s"], tuple(each["local_tasks"])
        )
        for each in told["faults"]
        if each["kind"] == "minor"
    ]
    until = [each["until_s"] for each in told["faults"] if each["kind"] == "major"]
    order = sorted(told["takeovers"], key=lambda each: (each["at_s"] or 0, each["robot"]))
    major = [_takeover(each, end) for each, end in zip(order, until, strict=True)]
    return RunReport(
        title,
        str(told["mission"]),
        str(told["result"]),
        float(told["duration_s"] or 0),
        tuple(
            RobotUse(name, str(each["type"] or ""), str(each["state"] or ""), 0.0, 0.0, 0.0, 0)
            for name, each in told["robots"].items()
        ),
        tuple(sorted([*major, *minor], key=lambda fault: (fault.at_s, fault.robot))),
        tuple(
            TaskEnd(name, str(task["status"]), tuple(task["robots"]))
            for name, task in told["global_tasks"].items()
        ),
        notes=(NO_RECORDING, *map(str, told.get("violations", ()))),
    )


def report_drill(told: Mapping[str, Any], title: str) -> RunReport:
    """One run of `mrbt drill --json`, from what was told alone; raises as `report_summary`."""
    return RunReport(
        title,
        str(told["drill"]),
        str(told["result"] or told["verdict"]),
        float(told["duration_s"]),
        faults=tuple(_takeover(each, None) for each in told["takeovers"]),
        verdict=str(told["verdict"]),
        expectations=drill_expectations(told),
        notes=(str(told["skipped"]) if told["skipped"] else NO_RECORDING,),
    )


def drill_expectations(told: Mapping[str, Any]) -> tuple[Expectation, ...]:
    """What one run of a drill had to show."""
    return tuple(
        Expectation(str(each["expected"]), bool(each["holds"]), str(each["found"]))
        for each in told["expectations"]
    )


def report_campaign(told: Mapping[str, Any], title: str) -> CampaignReport:
    """What `mrbt chaos --json` tells; raises as `report_summary`."""
    return CampaignReport(
        title,
        int(told["seeds"]),
        float(told["took_s"]),
        {str(name): int(count) for name, count in told["results"].items()},
        {str(name): int(count) for name, count in told["checks"].items()},
        {int(each["seed"]): tuple(map(str, each["violations"])) for each in told["failures"]},
    )


def _takeover(told: Mapping[str, Any], until_s: float | None) -> ReportedFault:
    return ReportedFault(
        str(told["robot"]),
        float(told["at_s"] or 0),
        until_s,
        (),
        milliseconds(told["detected_s"]),
        milliseconds(told["reassigned_s"]),
        told["held"],
        told["replacement"],
    )
