"""The timeline of a run as files: SVG for documents, CSV (RFC 4180) for tables."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.views.model.team_view import Shown
from mrbt_mesh.views.report.gantt import gantt_file
from mrbt_mesh.views.report.model import ReportedFault, ReportedWork, RobotUse, RunReport

# Kind of an item -> the items of a timeline, oldest first; see `TimelineView`.
Items: TypeAlias = Mapping[str, list[dict[str, Any]]]
EVENTS = ("at_s", "text")
ASSIGNMENTS = (
    *("robot", "global_task", "local_task", "claimed_s", "running_s", "ended_s", "end", "reason"),
)


def exported(name: str, shown: Shown, until_s: float) -> str:
    """The file `name`, one of `EXPORTS`, of a run until that time. Raises KeyError."""
    items: dict[str, list[Any]] = {"work": [], "fault": [], "loss": [], "event": []}
    changes = shown.changes.since(0)
    for key in sorted(changes, key=lambda key: (len(key), key)):
        kind = key.partition("/")[0]
        if kind in items:
            items[kind].append(changes[key])
    return EXPORTS[name](items, shown.observer, until_s)


def file_name(name: str, observer: Observer) -> str:
    """What the file is called, after the run."""
    run = re.sub(r"[^\w.-]", "_", f"{observer.mission.name}-{observer.facts.run}")
    return f"{run}-{name}"


def write_exports(folder: Path, shown: Shown, until_s: float) -> list[Path]:
    """Write all files into a folder, which is made if needed. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {name: folder / file_name(name, shown.observer) for name in EXPORTS}
    for name, path in paths.items():
        path.write_text(exported(name, shown, until_s), encoding="utf-8", newline="")
    return list(paths.values())


def _table(columns: tuple[str, ...], rows: list[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, extrasaction="ignore")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _events(items: Items, observer: Observer, until_s: float) -> str:
    return _table(EVENTS, items["event"])


def _assignments(items: Items, observer: Observer, until_s: float) -> str:
    return _table(ASSIGNMENTS, items["work"])


def _timeline(items: Items, observer: Observer, until_s: float) -> str:
    run = RunReport(
        f"{observer.mission.name}, run {observer.facts.run}",
        observer.mission.name,
        "",
        until_s,
        tuple(RobotUse(robot, "", "", 0, 0, 0, 0) for robot in observer.mission.robots),
        (*map(_fault, items["fault"]), *map(_loss, items["loss"])),
        work=tuple(_work(item, until_s) for item in items["work"] if item["claimed_s"] is not None),
    )
    return gantt_file(run)


def _work(item: Mapping[str, Any], until_s: float) -> ReportedWork:
    ended_s = until_s if item["ended_s"] is None else item["ended_s"]
    names = (item["robot"], item["global_task"], item["local_task"])
    return ReportedWork(*names, item["claimed_s"], item["running_s"], ended_s, item["end"])


def _fault(item: Mapping[str, Any]) -> ReportedFault:
    return ReportedFault(
        item["robot"],
        item["at_s"] or 0.0,
        item["until_s"],
        (),
        _us(item["detected_ms"]),
        _us(item["taken_over_ms"]),
        item["held"],
        item["replacement"],
        exact=item["has_ended"],
    )


def _loss(item: Mapping[str, Any]) -> ReportedFault:
    lost = tuple(item["local_tasks"])
    at_s = item["at_s"] or 0.0
    return ReportedFault(item["robot"], at_s, item["until_s"], lost, reason=item["reason"])


def _us(after_ms: float | None) -> int | None:
    return None if after_ms is None else round(after_ms * 1e3)


EXPORTS: Mapping[str, Callable[[Items, Observer, float], str]] = {
    "timeline.svg": _timeline,
    "events.csv": _events,
    "assignments.csv": _assignments,
}
