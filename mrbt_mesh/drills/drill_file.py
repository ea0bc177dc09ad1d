"""Load drill files: one drill per combination of `for_each`, checked against its mission."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.model import (
    DRILL_EXPLAINED,
    NETWORK_FAULTS,
    ROUTER_FAULTS,
    CycleModel,
    DrillModel,
    DrillReport,
    Robots,
    RoleModel,
    StepModel,
)
from mrbt_mesh.errors import nearest, whole_file_error
from mrbt_mesh.formats.file_model import explain
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.shipped import shipped
from mrbt_mesh.formats.yaml_source import SourceDict, read_mapping

MAX_INSTANCES = 1_000
FOLDER = "drills"

_REFERENCE = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")


@dataclass(frozen=True)
class Drill:
    """One drill, ready to run. `label` is its name with the values of `for_each`."""

    path: Path
    label: str
    model: DrillModel
    steps: tuple[StepModel, ...]
    mission: Mission
    mission_path: Path
    robots: tuple[str, ...]


def drill_folder() -> Path:
    """Return the folder of drills: `drills/` here if it has any, else the drills of the project."""
    here = Path.cwd() / FOLDER
    return here if any(here.glob("*.yaml")) else shipped(FOLDER)


def drill_files(folder: Path) -> list[Path]:
    """Return the drill files of a folder, sorted. Raises FileError if it has none."""
    paths = sorted(folder.glob("*.yaml"))
    if not paths:
        raise whole_file_error(str(folder), "the folder has no drill (*.yaml)")
    return paths


def load_drills(path: Path) -> list[Drill]:
    """Load the drills of a file, in the order of its `for_each`.

    Raises only FileError, for anything wrong with the file or its mission.
    """
    data, read = read_mapping(path, "a drill is expected (name: ..., steps: ...)")
    read.raise_if_any()
    report = DrillReport(read.file, read.lines)
    drills = []
    missions: dict[Path, Mission] = {}
    for values in _combinations(data, report):
        ground = _substituted(data, values, report)
        # An unresolved name would be reported a second time.
        report.raise_if_any()
        drill = _load_one(path, ground, values, report, missions)
        if drill is not None:
            drills.append(drill)
    report.raise_if_any()
    return drills


def _combinations(data: Mapping[str, Any], report: Report) -> Iterator[dict[str, Any]]:
    """Yield the combinations of `for_each`, the last name changing fastest.

    Without it, an empty one.
    """
    given = data.get("for_each", {})
    if not isinstance(given, dict):
        report.add(("for_each",), f"a mapping of names to lists is expected, found {found(given)}")
        return
    for name, values in given.items():
        if not isinstance(values, list) or not values:
            report.add(("for_each", name), f"a list of values is expected, found {found(values)}")
            return
    count = 1
    for values in given.values():
        count *= len(values)
    if count > MAX_INSTANCES:
        report.add(("for_each",), f"{count} combinations; at most {MAX_INSTANCES} are run")
        return
    for combination in itertools.product(*given.values()):
        yield dict(zip(given, combination, strict=True))


def _substituted(
    data: Any, values: Mapping[str, Any], report: Report, path: SourcePath = ()
) -> Any:
    """Return the data with `$name` replaced.

    A text that is only `$name` becomes the value itself.
    """
    if isinstance(data, SourceDict):
        copy = SourceDict({k: _substituted(v, values, report, (*path, k)) for k, v in data.items()})
        copy.path = path
        return copy
    if isinstance(data, list):
        return [_substituted(v, values, report, (*path, i)) for i, v in enumerate(data)]
    if not isinstance(data, str) or path[:1] in (("for_each",), ("description",)):
        return data
    for name in _REFERENCE.findall(data):
        if name not in values:
            report.add(path, f"no ${name} in for_each{nearest(name, values)}")
            return data
    whole = _REFERENCE.fullmatch(data)
    if whole:
        return values[whole[1]]
    return _REFERENCE.sub(lambda match: str(values[match[1]]), data)


def _load_one(
    path: Path,
    data: Any,
    values: Mapping[str, Any],
    report: DrillReport,
    missions: dict[Path, Mission],
) -> Drill | None:
    given = data.get("mission")
    mission_path = (path.parent / given).resolve() if isinstance(given, str) else path
    if not mission_path.is_file():
        report.add(("mission",), f"there is no such file: {mission_path}")
    elif isinstance(given, str):
        mission = missions.get(mission_path) or load_mission(mission_path)
        missions[mission_path] = report.mission = mission
        if mission.program is None:
            report.add(("mission",), f"{mission_path} names no program")
    try:
        model = DrillModel.model_validate(data, context=report)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            report.add(*explain(detail, DRILL_EXPLAINED))
        return None
    if report.mission is None:
        return None
    _check(model, report)
    where = ",".join(f"{name}={value}" for name, value in values.items())
    return Drill(
        path,
        f"{model.name}[{where}]" if where else model.name,
        model,
        tuple(model.unrolled()),
        report.mission,
        mission_path,
        tuple(sorted(report.mission.robots if model.robots is None else model.robots)),
    )


def _check(model: DrillModel, report: DrillReport) -> None:
    """Report contradictions between parts of a drill."""
    if model.routers and (model.network != "loopback" or model.profiles != ["wired"]):
        report.add(("routers",), "routers need `network: loopback`, `transport: wired`")
    try:
        Timing(round(model.timing.beat_s * SECOND_US), round(model.timing.detection_s * SECOND_US))
    except ValueError as error:
        report.add(("timing",), str(error))
    at_s = 0.0
    for path, step in _steps(model):
        if step.at is not None:
            if len(path) > 2:
                report.add((*path, "at"), "a step that is repeated has no `at`; use after")
            elif step.at < at_s:
                report.add((*path, "at"), f"the step before is at {at_s:g} already")
            at_s = step.at
        for name, fault in step.faults():
            if name in NETWORK_FAULTS and model.network != "namespaces":
                report.add((*path, name), f"{name} needs `network: namespaces`")
            if name in ROUTER_FAULTS and fault > model.routers:
                text = f"there is no router {fault}: the drill's `routers` is {model.routers}"
                report.add((*path, name), text)
        if step.join is not None:
            _check_join(step.join, model, (*path, "join"), report)


def _steps(model: DrillModel) -> Iterator[tuple[SourcePath, StepModel]]:
    for i, item in enumerate(model.steps):
        if isinstance(item, CycleModel):
            yield from ((("steps", i, "steps", j), step) for j, step in enumerate(item.steps))
        else:
            yield ("steps", i), item


def _check_join(robots: Robots, model: DrillModel, path: SourcePath, report: DrillReport) -> None:
    assert report.mission is not None
    if isinstance(robots, RoleModel):
        report.add(path, "a robot, or a list of robots, is expected; see also restart")
        return
    for robot in [robots] if isinstance(robots, str) else robots:
        if robot in (model.robots or report.mission.robots):
            text = f"{robot} is in the team from the start; leave it out of `robots`"
            report.add(path, text)
