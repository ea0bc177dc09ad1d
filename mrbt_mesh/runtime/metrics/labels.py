"""Labels for what has a name: those of the mission file, so that there are few."""

from __future__ import annotations

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name

# What a name stands for that the mission does not have.
OTHER = "other"


def robot_label(mission: Mission, name: str) -> str:
    """A robot's name, if the mission lists it."""
    return name if name in mission.robots else OTHER


def task_label(mission: Mission, local_task: str) -> str:
    """The type of a local task, if the mission has it."""
    name = type_name(local_task)
    return name if name in mission.local_tasks else OTHER
