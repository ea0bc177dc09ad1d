"""The field `constraints` of a mission file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field
from pydantic.fields import FieldInfo

from mrbt_mesh.features.constraints.kinds import SECTION
from mrbt_mesh.formats.file_model import Count, FileModel, GroundText, RobotName

MAX_CONSTRAINTS = 100


class NeverTogetherModel(FileModel):
    """At most one of these robots on the same demand; of `local_tasks` only, if there are any."""

    robots: Annotated[list[RobotName], Field(min_length=2)]
    local_tasks: list[GroundText] = []


class AtMostModel(FileModel):
    """At most `count` of these robots at work at the same time."""

    robots: Annotated[list[RobotName], Field(min_length=2)]
    count: Count = 1


class NotAtOnceModel(FileModel):
    """At most `count` requests for these global tasks served at the same time.

    A type means all its tasks.
    """

    global_tasks: Annotated[list[GroundText], Field(min_length=1)]
    count: Count = 1


class ConstraintsModel(FileModel):
    """Robots that may not work together, or at the same time; see docs/how-to/constraints.md."""

    never_together: Annotated[list[NeverTogetherModel], Field(max_length=MAX_CONSTRAINTS)] = []
    at_most: Annotated[list[AtMostModel], Field(max_length=MAX_CONSTRAINTS)] = []
    not_at_once: Annotated[list[NotAtOnceModel], Field(max_length=MAX_CONSTRAINTS)] = []


FIELDS: Mapping[str, Mapping[str, tuple[Any, FieldInfo]]] = {
    "MissionModel": {SECTION: (ConstraintsModel, FieldInfo(default_factory=ConstraintsModel))},
}
