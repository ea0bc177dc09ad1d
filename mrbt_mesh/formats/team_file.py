"""The team that a single robot's tree is lifted for: a mission file without tasks and tree.

    program: robot.py
    local_tasks:
      open_door:
        parameters: [room]
        work: 2
        requires: {unlocked: true}            # it succeeds if this holds
        effects: {door_open($room): true}     # and then this holds
        reads: [map]                          # anything else that it reads, changes,
        writes: [log]
        uses: [crane]                         # or needs for itself
        may_fail: true                        # even if all that it requires holds
    conditions: {holding: {per: robot}}       # every robot has its own
    resources: {gripper: {per: robot}}        # others there is one of for the whole team
    robot_types: {Arm: {capabilities: {open_door: 1}}}
    robots: {R1: Arm, R2: Arm}

A local task without any of the keys from `requires` to `may_fail` declares nothing: it may do
anything.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field, JsonValue

from mrbt_mesh.core.mission.mission import MAX_ROBOTS, performance
from mrbt_mesh.core.mission.names import split_call, type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.expand import call_text, micro_or_report, split_template, to_micro
from mrbt_mesh.formats.file_model import FileModel, Name, RobotName, read_model
from mrbt_mesh.formats.mission_model import (
    EXPLAINED_HERE,
    ConditionModel,
    LocalTaskModel,
    Per,
    ProgramText,
    RobotEntry,
    RobotTypeModel,
)
from mrbt_mesh.formats.problems import Report
from mrbt_mesh.formats.tree_model import CallText
from mrbt_mesh.formats.yaml_source import read_mapping

DECLARES = ("reads", "writes", "uses", "requires", "effects", "may_fail")


class TeamTaskModel(LocalTaskModel):
    """A local-task type and what its action does to the world."""

    reads: list[CallText] = []
    writes: list[CallText] = []
    uses: list[CallText] = []
    requires: dict[CallText, bool] = {}
    may_fail: bool = False


class UnitTaskModel(TeamTaskModel):
    """A local task that is a unit of a tree; no team file has one, `mrbt tree lift` makes them."""

    tree: str = ""
    ports: dict[str, str] = {}


class ResourceModel(FileModel):
    """Something that actions use: there is one for the team, or every robot has its own."""

    per: Per = "team"


class TeamModel(FileModel):
    """A team and what its local tasks do."""

    mission: Name | None = None
    program: ProgramText | None = None
    parameters: dict[Name, JsonValue] = {}
    local_tasks: dict[Name, TeamTaskModel]
    conditions: dict[Name, ConditionModel] = {}
    resources: dict[Name, ResourceModel] = {}
    robot_types: dict[Name, RobotTypeModel]
    robots: Annotated[dict[RobotName, RobotEntry], Field(min_length=1, max_length=MAX_ROBOTS)]


@dataclass(frozen=True)
class TeamFile:
    """A team file that has been read. `declared`: what ground actions do, beside the file."""

    model: TeamModel
    file: str
    declared: Mapping[str, Declaration] = field(default_factory=dict)

    def parameters(self, task: str) -> list[str] | None:
        """The parameters of a local-task type; None if there is none of that name."""
        found = self.model.local_tasks.get(task)
        return None if found is None else list(found.parameters)

    def belongs_to_robots(self, condition: str) -> bool:
        """Whether every robot has its own value of a condition, given ground."""
        declared = self.model.conditions.get(type_name(condition))
        return declared is not None and declared.per == "robot"

    def default(self, condition: str) -> bool:
        """The value of a condition, given ground, until it is set."""
        declared = self.model.conditions.get(type_name(condition))
        return declared is not None and declared.default

    def shared(self, resources: Iterable[str]) -> frozenset[str]:
        """Those, given ground, of which the team has one: with their own, robots are not in each
        other's way, and a robot never does two things at once.
        """
        own = {name for name, resource in self.model.resources.items() if resource.per == "robot"}
        return frozenset(name for name in resources if type_name(name) not in own)

    def capable(self, *actions: str) -> list[str]:
        """The robots that can do all these actions, given ground."""
        return [
            robot
            for robot in self.model.robots
            if all(performance(self.capabilities_of(robot), action) for action in actions)
        ]

    def capabilities_of(self, robot: str) -> dict[str, int]:
        """What a robot can do, in micro-units; of a type that is unknown, nothing."""
        entry = self.model.robots[robot]
        if isinstance(entry, str):
            return self.capabilities_of_type(entry)
        return self.capabilities_of_type(entry.type) | _micro(entry.capabilities)

    def capabilities_of_type(self, kind: str) -> dict[str, int]:
        """What robots of a type can do."""
        found = self.model.robot_types.get(kind)
        return _micro(found.capabilities) if found is not None else {}

    def work_us(self, ground: str) -> int:
        """How long an action takes a robot of performance 1, in microseconds."""
        return to_micro(self.model.local_tasks[split_call(ground)[0]].work)

    def declaration(self, ground: str) -> Declaration | None:
        """What the action `name(arguments)` does; None if it declares nothing."""
        if ground in self.declared:
            return self.declared[ground]
        name, arguments = split_call(ground)
        task = self.model.local_tasks[name]
        if not task.model_fields_set & set(DECLARES):
            return None
        values = dict(zip(task.parameters, arguments, strict=True))

        def filled(texts: Iterable[str]) -> frozenset[str]:
            return frozenset(_filled(text, values) for text in texts)

        return Declaration(
            filled(task.reads),
            filled(task.writes),
            self.shared(filled(task.uses)),
            {_filled(text, values): value for text, value in task.requires.items()},
            {_filled(text, values): value for text, value in task.effects.items()},
            task.may_fail,
            self.work_us(ground),
        )


def _micro(capabilities: Mapping[str, float | None]) -> dict[str, int]:
    return {
        call_text(*split_template(text)): to_micro(value or 0)
        for text, value in capabilities.items()
    }


def _filled(text: str, values: Mapping[str, str]) -> str:
    """`door_open($room)` with the value of `room`."""
    name, arguments = split_template(text)
    ground = [values[a[1:]] if a.startswith("$") else a for a in arguments]
    return call_text(name, ground)


def load_team(path: Path, text: str | None = None) -> TeamFile:
    """Read a team file; with `text` that in its place. Raises FileError with all problems."""
    expected = "a team is expected (local_tasks: ..., robots: ...)"
    data, report = read_mapping(path, expected, text)
    for key in ("tree", "global_tasks", "subtrees"):
        if key in data:
            report.add((key,), f"a team file has no {key}: they come from the tree that is lifted")
            del data[key]
    model = read_model(TeamModel, data, report, EXPLAINED_HERE)
    _check(model, report)
    report.raise_if_any()
    return TeamFile(model, str(path))


def _check(model: TeamModel, report: Report) -> None:
    for name, task in model.local_tasks.items():
        micro_or_report(task.work, ("local_tasks", name, "work"), report)
        known = set(task.parameters)
        for key in DECLARES[:-1]:
            for position, text in enumerate(getattr(task, key)):
                place = position if isinstance(getattr(task, key), list) else text
                for argument in split_template(text)[1]:
                    if argument.startswith("$") and argument[1:] not in known:
                        message = f"unknown parameter {argument}{nearest(argument[1:], known)}"
                        report.add(("local_tasks", name, key, place), message)
