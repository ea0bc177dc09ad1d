"""Costs from a separate file, for `mrbt analyze --costs FILE`; they override the mission's.

robot_types: {A: 10, C: 40}         # one more robot
local_tasks: {move_frame: 5}        # one more robot that is capable of it
"""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from mrbt_mesh.core.mission.mission import Costs, Mission
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.file_model import FileModel, Name, read_model
from mrbt_mesh.formats.mission_model import Cost
from mrbt_mesh.formats.yaml_source import read_mapping


class _CostsModel(FileModel):
    robot_types: dict[Name, Cost] = Field(default={})
    local_tasks: dict[Name, Cost] = Field(default={})


def costs_from_file(path: Path, mission: Mission) -> Costs:
    """Return the mission's costs, overridden by those of the file.

    Raises FileError with file and line for everything that is wrong with the file.
    """
    data, report = read_mapping(path, "robot_types: ... is expected")
    model = read_model(_CostsModel, data, report)
    for section, names, known in (
        ("robot_types", model.robot_types, mission.robot_types),
        ("local_tasks", model.local_tasks, mission.local_tasks),
    ):
        for name in names:
            if name not in known:
                text = f"the mission has no {section[:-1].replace('_', ' ')} {name!r}"
                report.add((section, name), text + nearest(name, known))
    report.raise_if_any()
    return Costs(
        dict(mission.costs.robots) | model.robot_types,
        dict(mission.costs.capabilities) | model.local_tasks,
    )
