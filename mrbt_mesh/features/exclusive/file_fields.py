"""The fields of global tasks in a mission file that say how robots work jointly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field
from pydantic.fields import FieldInfo

from mrbt_mesh.formats.tree_model import MAX_SECONDS

SIMULTANEOUS, BEGIN_WITHIN_S = "simultaneous", "begin_within_s"
EXCLUSIVE, IN_DOUBT = "exclusive", "in_doubt"
_WITHIN_TEXT = (
    "Of simultaneous tasks: what the robots did counts only if all began within this time "
    "(default: the detection time)."
)
_IN_DOUBT_TEXT = (
    "What becomes of an exclusive task whose robot vanished in the middle: it is held for the "
    "operator (hold, the default), counts as failed (fail) or is tried again (retry)."
)
_WithinS = Annotated[float, Field(gt=0, le=MAX_SECONDS)]
FIELDS: Mapping[str, Mapping[str, tuple[Any, FieldInfo]]] = {
    "GlobalTaskModel": {
        SIMULTANEOUS: (bool, FieldInfo(default=False, description="Its robots start together.")),
        BEGIN_WITHIN_S: (_WithinS | None, FieldInfo(default=None, description=_WITHIN_TEXT)),
        EXCLUSIVE: (bool, FieldInfo(default=False, description="It is never done twice.")),
        IN_DOUBT: (
            Literal["hold", "fail", "retry"] | None,
            FieldInfo(default=None, description=_IN_DOUBT_TEXT),
        ),
    }
}
