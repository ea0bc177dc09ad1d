"""Base classes for files that bind a mission's local tasks to another system, and their programs.

Texts in such a file may contain `$name`: a parameter of the local task, or a value of the robot.
"""

from __future__ import annotations

import difflib
import re
from abc import abstractmethod
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Any, ClassVar, TypeAlias, TypeVar

import anyio
from pydantic import PrivateAttr

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.file_model import FileModel, Name, read_model
from mrbt_mesh.formats.problems import Report, SourcePath
from mrbt_mesh.formats.tree_model import CallText
from mrbt_mesh.formats.yaml_source import read_mapping
from mrbt_mesh.runtime.context import RobotContext

Tables: TypeAlias = Mapping[str, Mapping[str, Any]]
Problems: TypeAlias = Iterator[tuple[SourcePath, str]]

_WHOLE = re.compile(r"\$([A-Za-z_]\w*)((?:\.\w+)*)")


# -- templates --------------------------------------------------------------------------------


class FillError(Exception):
    """A task's arguments do not fit its template; the text is the reason."""


@dataclass(frozen=True)
class KnownValues:
    """The values of `$name`.

    If a name has a table, a text that is just `$name` becomes the table's value, and `$name.part` a
    part of that value.
    """

    values: Mapping[str, str]
    tables: Tables = field(default_factory=dict)

    def text(self, text: str) -> str:
        """Return a text with values filled in."""
        return Template(text).safe_substitute(self.values)

    def data(self, data: Any) -> Any:
        """Return plain data with values filled in; unknown names keep `$`. Raises FillError."""
        if isinstance(data, str):
            whole = _WHOLE.fullmatch(data)
            return self._whole(whole[1], whole[2], data) if whole else self.text(data)
        if isinstance(data, Mapping):
            return {key: self.data(value) for key, value in data.items()}
        if isinstance(data, list | tuple):
            return [self.data(value) for value in data]
        return data

    def _whole(self, name: str, path: str, text: str) -> Any:
        table = self.tables.get(name)
        if name not in self.values or (table is None and not path):
            return self.text(text)
        argument = self.values[name]
        if table is None:
            raise FillError(f"{text}: values has no table for {name}")
        if argument not in table:
            raise FillError(f"values/{name} has no {argument!r}{nearest(argument, table)}")
        value = table[argument]
        for key in path.split(".")[1:]:
            if not isinstance(value, Mapping) or key not in value:
                known = value if isinstance(value, Mapping) else ()
                raise FillError(f"{text}: {argument} has no {key!r}{nearest(key, known)}")
            value = value[key]
        return KnownValues(self.values).data(value)


def unknown_names(
    data: Any, names: Collection[str], place: SourcePath, tables: Collection[str] = ()
) -> Problems:
    """Yield the problems with `$` in plain data.

    These are each `$name` that is not among the names, each `$` without a name, and each
    `$name.part` of a name without a table.
    """
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from unknown_names(key, names, (*place, key), tables)
            yield from unknown_names(value, names, (*place, key), tables)
    elif isinstance(data, list | tuple):
        for index, value in enumerate(data):
            yield from unknown_names(value, names, (*place, index), tables)
    elif isinstance(data, str):
        for name in Template(data).get_identifiers():
            if name not in names:
                yield place, f"unknown ${name}{nearest(name, names)}"
        whole = _WHOLE.fullmatch(data)
        if whole and whole[2] and whole[1] in names and whole[1] not in tables:
            yield place, f"{data}: values has no table for {whole[1]}"
        if not Template(data).is_valid():
            yield place, f"{data!r}: after $ a name is expected; $$ is a dollar sign"


# -- files ------------------------------------------------------------------------------------


class BoundTask(FileModel):
    """A local task; `sets`: the conditions that it sets when it has succeeded."""

    parameters: list[Name] = []
    sets: Mapping[CallText, Any] = {}

    def known(
        self,
        arguments: Sequence[str],
        robot_values: Mapping[str, str] | None = None,
        tables: Tables | None = None,
    ) -> KnownValues:
        """Return the values of `$name` for a ground local task. Raises FillError."""
        if len(arguments) != len(self.parameters):
            wanted = ", ".join(self.parameters) or "none"
            raise FillError(f"the file has other parameters: {wanted}")
        values = dict(zip(self.parameters, arguments, strict=True))
        return KnownValues({**(robot_values or {}), **values}, tables or {})


class BoundFile(FileModel):
    """A whole file. `ROBOTS`: the key of its robots."""

    ROBOTS: ClassVar[str]
    local_tasks: Mapping[Name, BoundTask]
    _report: Report = PrivateAttr()

    @property
    def file(self) -> str:
        """The file's path as it was given."""
        return self._report.file

    def new_report(self) -> Report:
        """Return an empty report on this file."""
        return Report(self.file, self._report.lines)

    @abstractmethod
    def problems(self) -> Problems:
        """Yield the problems of the file beyond the shape of single parts."""

    def condition_places(self) -> Problems:
        """Yield the place in the file and the name of each condition that is set."""
        for name, task in self.local_tasks.items():
            yield from ((("local_tasks", name, "sets", c), c) for c in task.sets)

    def check_mission(self, mission: Mission, robots: Iterable[str]) -> None:
        """Raise FileError if the file does not fit a mission and its participating robots.

        Local tasks that the mission lacks are ignored: a file may serve several missions.
        """
        report = self.new_report()
        for name, task in self.local_tasks.items():
            declared = mission.local_tasks.get(name)
            if declared is not None and len(declared.parameters) != len(task.parameters):
                own, wanted = (", ".join(each) for each in (task.parameters, declared.parameters))
                text = f"the parameters are [{own}], but the mission declares {name}({wanted})"
                report.add(("local_tasks", name, "parameters"), text)
        for place, condition in self.condition_places():
            name = type_name(condition)
            if name not in mission.truths:
                hint = nearest(name, mission.truths)
                report.add(place, f"mission {mission.name} has no condition {name!r}{hint}")
            elif _count(condition) != len(parameters := mission.truths[name].parameters):
                wanted = f"{name}({', '.join(parameters)})" if parameters else name
                report.add(place, f"mission {mission.name} declares {wanted}, not {condition}")
        self._check_names(mission, report)
        for place, text in self.mission_problems(mission, robots):
            report.add(place, text)
        known = getattr(self, self.ROBOTS)
        for robot in sorted(set(robots) - set(known)) if known else ():
            report.add((self.ROBOTS,), f"the mission's robot {robot} is missing here")
        report.raise_if_any()

    def _check_names(self, mission: Mission, report: Report) -> None:
        """Report local tasks that the mission lacks but that look like misspelt ones."""
        unbound = sorted(mission.local_tasks.keys() - self.local_tasks.keys())
        for name in self.local_tasks.keys() - mission.local_tasks.keys():
            if difflib.get_close_matches(name, unbound, n=1, cutoff=0.8):
                text = f"mission {mission.name} has no local task {name!r}{nearest(name, unbound)}"
                report.add(("local_tasks", name), text)

    def mission_problems(self, mission: Mission, robots: Iterable[str]) -> Problems:
        """Yield further problems with a mission; for subclasses."""
        return iter(())


def _count(call: str) -> int:
    """Return the number of arguments of a condition, as in `seen($place)`."""
    return call.count(",") + 1 if "(" in call else 0


_File = TypeVar("_File", bound=BoundFile)


def load_bound(kind: type[_File], path: Path, expected: str, explained: Mapping[str, str]) -> _File:
    """Read a file; `explained` as in `read_model`. Raises FileError with all problems found."""
    data, report = read_mapping(path, expected)
    found = read_model(kind, data, report, explained)
    for place, text in found.problems():
        report.add(place, text)
    report.raise_if_any()
    found._report = report
    return found


# -- programs ---------------------------------------------------------------------------------


class News:
    """Wakes all tasks that wait for a change."""

    def __init__(self) -> None:
        self._event = anyio.Event()

    def tell(self) -> None:
        """Wake the waiting tasks, because something has changed."""
        self._event.set()
        self._event = anyio.Event()

    async def wait(self) -> None:
        """Wait for the next change."""
        await self._event.wait()


ALL = "all"


class LostCapabilities:
    """Reports a robot's lost and restored capabilities to the team, but only changes."""

    def __init__(self) -> None:
        self._told: Mapping[str, tuple[str, bool]] = {}

    def tell(self, robot: RobotContext, lost: Mapping[str, tuple[str, bool]]) -> bool:
        """Report `lost`, which maps local tasks, or `ALL`, to (why, is pending).

        A pending capability is not available yet, which is not a fault. Returns whether anything
        has changed.
        """
        if lost == self._told:
            return False
        before, self._told = self._told, dict(lost)
        restored = set() if ALL in lost else before.keys() - lost.keys()
        for name in sorted(restored):
            robot.restore_capability(name)
        for name, (why, is_pending) in lost.items():
            if ALL not in restored and before.get(name) == (why, is_pending):
                continue
            if is_pending:
                robot.defer_capability(name, why)
            else:
                robot.lose_capability(name, why, is_watched=True)
        return True
