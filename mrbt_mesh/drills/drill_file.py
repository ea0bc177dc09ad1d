"""Load drill files: one drill per combination of `for_each`, checked against its mission."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mrbt_mesh.core.membership.timing import SECOND_US, Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.drills.model import (
    DRILL_EXPLAINED,
    NETWORK_FAULTS,
    BlockedTrigger,
    CapabilityModel,
    ConditionTrigger,
    CycleModel,
    DecisionModel,
    DrillModel,
    GlobalTaskTrigger,
    LinksModel,
    LocalTaskTrigger,
    PerformanceModel,
    RobotTrigger,
    RoleModel,
    StepModel,
    TakeoverTrigger,
)
from mrbt_mesh.errors import nearest, read_limited, whole_file_error
from mrbt_mesh.formats.file_model import explain
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.shipped import shipped
from mrbt_mesh.formats.yaml_source import SourceDict, decode, read_yaml

MAX_BYTES = 1 << 20
MAX_INSTANCES = 1_000
FOLDER = "drills"

_REFERENCE = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")


@dataclass(frozen=True)
class Drill:
    """One drill, ready to be carried out. `label` is its name with the values of `for_each`."""

    path: Path
    label: str
    model: DrillModel
    steps: tuple[StepModel, ...]
    mission: Mission
    mission_path: Path
    robots: tuple[str, ...]


def drill_folder() -> Path:
    """Where drills are: `drills/` here, else those that come with the project."""
    here = Path.cwd() / FOLDER
    return here if any(here.glob("*.yaml")) else shipped(FOLDER)


def drill_files(folder: Path) -> list[Path]:
    """The drill files of a folder, sorted; raises FileError if it has none."""
    paths = sorted(folder.glob("*.yaml"))
    if not paths:
        raise whole_file_error(str(folder), "the folder has no drill (*.yaml)")
    return paths


def load_drills(path: Path) -> list[Drill]:
    """The drills of a file, in the order of its `for_each`.

    Raises FileError, and nothing else, for whatever may be wrong with it or its mission.
    """
    file = str(path)
    data, report = read_yaml(decode(read_limited(path, MAX_BYTES), file), file)
    if not isinstance(data, dict):
        raise whole_file_error(
            file, f"a drill is expected (name: ..., steps: ...), found {found(data)}"
        )
    drills = []
    missions: dict[Path, Mission] = {}
    for values in _combinations(data, report):
        ground = _substituted(data, values, report)
        # What is left over of a name that is missing would be complained about again.
        report.raise_if_any()
        drill = _load_one(path, ground, values, report, missions)
        if drill is not None:
            drills.append(drill)
    report.raise_if_any()
    return drills


def _combinations(data: Mapping[str, Any], report: Report) -> Iterator[dict[str, Any]]:
    """The values of `for_each`, the last name changing fastest; one empty one without it."""
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
    """The data with `$name` replaced; a text that is nothing else becomes the value itself."""
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
    report: Report,
    missions: dict[Path, Mission],
) -> Drill | None:
    try:
        model = DrillModel.model_validate(data, context=report)
    except ValidationError as error:
        for detail in error.errors(include_url=False):
            report.add(*explain(detail, DRILL_EXPLAINED))
        return None
    mission_path = (path.parent / model.mission).resolve()
    if not mission_path.is_file():
        report.add(("mission",), f"there is no such file: {mission_path}")
        return None
    mission = missions.get(mission_path) or load_mission(mission_path)
    missions[mission_path] = mission
    if mission.program is None:
        report.add(("mission",), f"{mission_path} names no program")
    _Checker(model, mission, report).check()
    where = ",".join(f"{name}={value}" for name, value in values.items())
    return Drill(
        path,
        f"{model.name}[{where}]" if where else model.name,
        model,
        tuple(model.unrolled()),
        mission,
        mission_path,
        tuple(sorted(mission.robots if model.robots is None else model.robots)),
    )


class _Checker:
    """Checks a drill against its mission."""

    def __init__(self, model: DrillModel, mission: Mission, report: Report) -> None:
        self.model = model
        self.mission = mission
        self.report = report
        self.local_tasks = {n.local_task for t in mission.global_tasks.values() for n in t.needs}

    def check(self) -> None:
        model = self.model
        self.robots(("robots",), model.robots)
        if model.routers and (model.network != "loopback" or model.profiles != ["wired"]):
            self.report.add(("routers",), "routers need `network: loopback`, `transport: wired`")
        try:
            Timing(
                round(model.timing.beat_s * SECOND_US), round(model.timing.detection_s * SECOND_US)
            )
        except ValueError as error:
            self.report.add(("timing",), str(error))
        at_s = 0.0
        for path, step in self.steps():
            if step.at is not None:
                if len(path) > 2:
                    self.report.add((*path, "at"), "a step that is repeated has no `at`; use after")
                elif step.at < at_s:
                    self.report.add((*path, "at"), f"the step before is at {at_s:g} already")
                at_s = step.at
            self.when((*path, "when"), step.when)
            for name, fault in step.faults():
                self.fault((*path, name), name, fault)
        self.expect()

    def steps(self) -> Iterable[tuple[SourcePath, StepModel]]:
        for i, item in enumerate(self.model.steps):
            if isinstance(item, CycleModel):
                yield from ((("steps", i, "steps", j), step) for j, step in enumerate(item.steps))
            else:
                yield ("steps", i), item

    def when(self, path: SourcePath, when: Any) -> None:
        match when:
            case GlobalTaskTrigger(global_task=task):
                self.global_task((*path, "global_task"), task)
            case BlockedTrigger(blocked=task):
                self.global_task((*path, "blocked"), task)
            case LocalTaskTrigger(local_task=task, robot=robot):
                self.local_task((*path, "local_task"), task)
                self.robots((*path, "robot"), robot)
            case RobotTrigger(robot=robots):
                self.robots((*path, "robot"), robots)
            case TakeoverTrigger(takeover=task):
                self.local_task((*path, "takeover"), task)
            case ConditionTrigger(condition=condition):
                if not self.mission.knows_condition(condition):
                    hint = nearest(condition, self.mission.conditions)
                    self.report.add((*path, "condition"), f"no condition {condition!r}{hint}")

    def fault(self, path: SourcePath, name: str, fault: Any) -> None:
        if name in NETWORK_FAULTS and self.model.network != "namespaces":
            self.report.add(path, f"{name} needs `network: namespaces`")
        match fault:
            case True:
                pass
            case int():
                self.router(path, fault)
            case CapabilityModel(robots=robots, local_task=task):
                self.robots((*path, "robots"), robots)
                if task != "all":
                    self.local_task((*path, "local_task"), task)
            case PerformanceModel(robots=robots, local_task=task):
                self.robots((*path, "robots"), robots)
                self.local_task((*path, "local_task"), task)
            case DecisionModel(global_task=task):
                self.global_task((*path, "global_task"), task)
            case LinksModel(source=source, target=target):
                self.robots((*path, "from"), source)
                self.robots((*path, "to"), target)
            case list() if name == "partition":
                for i, group in enumerate(fault):
                    self.robots((*path, i), group)
            case _:
                self.robots(path, fault)
                if name == "join":
                    self.join(path, fault)

    def router(self, path: SourcePath, number: int) -> None:
        if number > self.model.routers:
            text = f"there is no router {number}: the drill's `routers` is {self.model.routers}"
            self.report.add(path, text)

    def join(self, path: SourcePath, robots: Any) -> None:
        started = self.model.robots or list(self.mission.robots)
        listed = [robots] if isinstance(robots, str) else robots
        if isinstance(listed, RoleModel):
            self.report.add(path, "a robot, or a list of robots, is expected; see also restart")
            return
        for robot in listed:
            if robot in started:
                self.report.add(
                    path, f"{robot} is in the team from the start; leave it out of `robots`"
                )

    def expect(self) -> None:
        expect = self.model.expect
        for i, done in enumerate(expect.done):
            self.local_task(("expect", "done", i, "local_task"), done.local_task)
            if done.global_task is not None:
                self.global_task(("expect", "done", i, "global_task"), done.global_task)
        for i, never in enumerate(expect.never):
            self.local_task(("expect", "never", i, "local_task"), never.local_task)
        for i, task in enumerate(expect.was_blocked):
            self.global_task(("expect", "was_blocked", i), task)
        for name in ("dead", "alive", "left", "yields"):
            self.robots(("expect", name), getattr(expect, name))

    # -- names ----------------------------------------------------------------------------

    def robots(self, path: SourcePath, robots: Any) -> None:
        if isinstance(robots, RoleModel):
            task = robots.performing
            known = {*self.mission.global_tasks, *self.local_tasks}
            if task is not None and task not in known:
                hint = nearest(task, known)
                self.report.add((*path, "performing"), f"no task {task!r} in this mission{hint}")
            return
        for robot in [robots] if isinstance(robots, str) else robots or []:
            if robot not in self.mission.robots:
                hint = nearest(robot, self.mission.robots)
                self.report.add(path, f"no robot {robot!r} in this mission{hint}")

    def global_task(self, path: SourcePath, task: str) -> None:
        if task not in self.mission.global_tasks:
            hint = nearest(task, self.mission.global_tasks)
            self.report.add(path, f"no global task {task!r} in this mission{hint}")

    def local_task(self, path: SourcePath, task: str) -> None:
        """A ground local task that the mission asks for, or the type of one."""
        types = {split_call(name)[0] for name in self.local_tasks}
        if task not in self.local_tasks and task not in types:
            hint = nearest(task, self.local_tasks | types)
            self.report.add(path, f"no local task {task!r} in this mission{hint}")
