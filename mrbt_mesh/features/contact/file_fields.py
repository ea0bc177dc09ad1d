"""The field `on_lost_contact` of robot types in a mission file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.fields import FieldInfo

from mrbt_mesh.features.contact.policy import SECTION
from mrbt_mesh.formats.file_model import FileModel, GroundText


class LostContactModel(FileModel):
    """What a robot does that has heard nobody for `after_s`: no robot of the `team`, no `majority`
    of the robots, or no `operator`.

    `then`: `finish` its task and begin no other, `hold` (cancel it), or `return`: cancel it and
    perform a local task.
    """

    after_s: Annotated[float, Field(ge=1, le=86_400)]
    of: Literal["team", "majority", "operator"] = "team"
    then: Literal["go_on", "finish", "hold", "return"]
    local_task: GroundText | None = Field(default=None, alias="return")


FIELDS: Mapping[str, Mapping[str, tuple[Any, FieldInfo]]] = {
    "RobotTypeModel": {SECTION: (LostContactModel | None, FieldInfo(default=None))},
}
