"""The field `performance` of needs in a mission file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, Tag
from pydantic.fields import FieldInfo

from mrbt_mesh.features.bids.needs import MAX_BID_WITHIN_US
from mrbt_mesh.formats.file_model import FileModel, by_type


class BidModel(FileModel):
    """Bids that are waited for this many seconds."""

    bid_within_s: Annotated[float, Field(gt=0, le=MAX_BID_WITHIN_US / 1_000_000)]


# The field's name in a file.
PERFORMANCE = "performance"
_Performance: TypeAlias = Annotated[
    Annotated[Literal["declared", "bid"], Tag("<text>")] | Annotated[BidModel, Tag("<mapping>")],
    by_type("declared, bid, or {bid_within_s: 0.5}", {str: "<text>", dict: "<mapping>"}),
]
_FIELD = FieldInfo(
    default="declared",
    description="`bid`: how well a robot does it is known only to the robot, which bids for it.",
)
FIELDS: Mapping[str, Mapping[str, tuple[Any, FieldInfo]]] = {
    "NeedModel": {PERFORMANCE: (_Performance, _FIELD)},
}
