"""The figures of what `mrbt sim`, `up`, `drill` and `chaos` tell with --json.

All raise KeyError, TypeError, ValueError or AttributeError for what is none of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.views.report.model import (
    CampaignReport,
    Expectation,
    ReportedFailure,
    ReportedFault,
    RobotUse,
    RunReport,
    TaskEnd,
    milliseconds,
)

# As long as no run is: what is longer was not told by a command.
MOST_S = 1e9
NO_RECORDING = "from a summary: who worked when, and who waited, is in the run's recording"


def report_summary(told: Mapping[str, Any], title: str) -> RunReport:
    """A run's summary."""
    minor = [
        ReportedFault(
            str(each["robot"]),
            seconds(each["at_s"]) or 0.0,
            seconds(each["until_s"]),
            _names(each["local_tasks"]),
            reason=str(each["reason"]),
        )
        for each in told["faults"]
        if each["kind"] == "minor"
    ]
    until = [seconds(each["until_s"]) for each in told["faults"] if each["kind"] == "major"]
    order = sorted(told["takeovers"], key=lambda each: (each["at_s"] or 0, each["robot"]))
    major = [_takeover(each, end) for each, end in zip(order, until, strict=True)]
    return RunReport(
        title,
        str(told["mission"]),
        str(told["result"]),
        seconds(told["duration_s"]) or 0.0,
        tuple(
            RobotUse(name, str(each["type"] or ""), str(each["state"] or ""), 0.0, 0.0, 0.0, 0)
            for name, each in told["robots"].items()
        ),
        tuple(sorted([*major, *minor], key=lambda fault: (fault.at_s, fault.robot))),
        tuple(
            TaskEnd(name, str(task["status"]), _names(task["robots"]))
            for name, task in told["global_tasks"].items()
        ),
        notes=(NO_RECORDING, *_names(told.get("violations", ()))),
        failures=reported_failures(told),
    )


def reported_failures(told: Mapping[str, Any]) -> tuple[ReportedFailure, ...]:
    """Those of a summary; one of an earlier version has none."""
    return tuple(
        ReportedFailure(
            str(each["robot"]),
            str(each["global_task"]),
            str(each["local_task"]),
            seconds(each["at_s"]),
            str(each["reason"]),
        )
        for each in told.get("failures", ())
    )


def report_drill(told: Mapping[str, Any], title: str) -> RunReport:
    """One run of `mrbt drill --json`, from what was told alone."""
    return RunReport(
        title,
        str(told["drill"]),
        str(told["result"] or told["verdict"]),
        seconds(told["duration_s"]) or 0.0,
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
    """What `mrbt chaos --json` tells."""
    return CampaignReport(
        title,
        int(told["seeds"]),
        seconds(told["took_s"]) or 0.0,
        {str(name): int(count) for name, count in told["results"].items()},
        {str(name): int(count) for name, count in told["checks"].items()},
        {int(each["seed"]): _names(each["violations"]) for each in told["failures"]},
    )


def _takeover(told: Mapping[str, Any], until_s: float | None) -> ReportedFault:
    return ReportedFault(
        str(told["robot"]),
        seconds(told["at_s"]) or 0.0,
        until_s,
        (),
        milliseconds(seconds(told["detected_s"])),
        milliseconds(seconds(told["reassigned_s"])),
        None if told["held"] is None else str(told["held"]),
        None if told["replacement"] is None else str(told["replacement"]),
    )


def seconds(told: Any) -> float | None:
    """A time as it was told; raises TypeError or ValueError for what is none."""
    if told is None:
        return None
    if not isinstance(told, int | float) or not abs(told) <= MOST_S:
        raise ValueError(f"{told!r} is no time in seconds")
    return float(told)


def _names(told: Any) -> tuple[str, ...]:
    return tuple(map(str, told))
