"""The figures in the summary of a run.

All functions raise KeyError, TypeError, ValueError or AttributeError for invalid data.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.views.report.model import (
    ReportedFailure,
    ReportedFault,
    RobotUse,
    RunReport,
    TaskEnd,
)

# No run takes longer, so no command has printed a larger time.
MOST_S = 1e9
NO_RECORDING = "from a summary: who worked when, and who waited, is in the run's recording"


def report_summary(data: Mapping[str, Any], title: str) -> RunReport:
    """Return the report of a run's summary."""
    minor = [
        ReportedFault(
            str(each["robot"]),
            seconds(each["at_s"]) or 0.0,
            seconds(each["until_s"]),
            _names(each["local_tasks"]),
            reason=str(each["reason"]),
        )
        for each in data["faults"]
        if each["kind"] == "minor"
    ]
    until = [seconds(each["until_s"]) for each in data["faults"] if each["kind"] == "major"]
    order = sorted(data["takeovers"], key=lambda each: (each["at_s"] or 0, each["robot"]))
    major = [_takeover(each, end) for each, end in zip(order, until, strict=True)]
    return RunReport(
        title,
        str(data["mission"]),
        str(data["result"]),
        seconds(data["duration_s"]) or 0.0,
        tuple(
            RobotUse(name, str(each["type"] or ""), str(each["state"] or ""), 0.0, 0.0, 0.0, 0)
            for name, each in data["robots"].items()
        ),
        tuple(sorted([*major, *minor], key=lambda fault: (fault.at_s, fault.robot))),
        tuple(
            TaskEnd(name, str(task["status"]), _names(task["robots"]))
            for name, task in data["global_tasks"].items()
        ),
        notes=(NO_RECORDING, *_names(data.get("violations", ()))),
        failures=reported_failures(data),
    )


def reported_failures(data: Mapping[str, Any]) -> tuple[ReportedFailure, ...]:
    """Return the failures in a summary; empty for a summary of an earlier version."""
    return tuple(
        ReportedFailure(
            str(each["robot"]),
            str(each["global_task"]),
            str(each["local_task"]),
            seconds(each["at_s"]),
            str(each["reason"]),
        )
        for each in data.get("failures", ())
    )


def _takeover(data: Mapping[str, Any], until_s: float | None) -> ReportedFault:
    return ReportedFault(
        str(data["robot"]),
        seconds(data["at_s"]) or 0.0,
        until_s,
        (),
        _microseconds(data["detected_s"]),
        _microseconds(data["reassigned_s"]),
        None if data["held"] is None else str(data["held"]),
        None if data["replacement"] is None else str(data["replacement"]),
        exact=bool(data["exact"]),
    )


def seconds(data: Any) -> float | None:
    """Return a time of a summary; raises TypeError or ValueError for anything else."""
    if data is None:
        return None
    if not isinstance(data, int | float) or not abs(data) <= MOST_S:
        raise ValueError(f"{data!r} is not a time in seconds")
    return float(data)


def _microseconds(data: Any) -> int | None:
    value = seconds(data)
    return None if value is None else round(value * 1e6)


def _names(data: Any) -> tuple[str, ...]:
    return tuple(map(str, data))
