"""The channels of a recording; channels.json has the JSON Schema of each channel's messages.

Foxglove's own schemas (`foxglove_schemas/`, with their licence) are referred to by file.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# The version of this format. A reader refuses recordings with another one.
FORMAT = "6"

FACTS, DROPPED, ALIVE, PLANS = "/facts", "/dropped", "/alive", "/plans"
STATUSES, ACTIONS, LIFE, ROBOTS = "/statuses", "/actions", "/life", "/robots"
ROBOT_TREES = "/robot_trees"
FAULTS, DEATHS, BEATS = "/faults", "/deaths", "/beats"
SIGNATURES, HEADS, PARTS, REVOKED = "/signatures", "/heads", "/parts", "/revoked"
POSITIONS, SCENE, MAP = "/positions", "/scene", "/map"

SCHEMAS = Path(__file__).with_name("foxglove_schemas")


@dataclass(frozen=True)
class Channel:
    """A channel: `schema` is the JSON Schema of its messages, `example` one without its `check`.

    `stands_for`: a message is valid until the next one with the same values in these fields; None:
    it is about a moment.
    """

    topic: str
    purpose: str
    schema: Mapping[str, Any]
    example: Mapping[str, Any]
    stands_for: tuple[str, ...] | None

    @property
    def name(self) -> str:
        """The name of the schema, e.g. `mrbt.Fact`."""
        return str(self.schema["title"])

    @property
    def schema_text(self) -> bytes:
        """The schema as it is written to recordings."""
        return json.dumps(self.schema).encode()


def _read(topic: str, stands_for: list[str] | None, schema: dict[str, Any], **row: Any) -> Channel:
    if "$ref" in schema:
        # It allows `check`, like any field that it does not list.
        schema = json.loads((SCHEMAS / schema["$ref"]).read_bytes())
    fields = None if stands_for is None else tuple(stands_for)
    return Channel(topic=topic, stands_for=fields, schema=schema, **row)


CHANNELS: Mapping[str, Channel] = {
    row["topic"]: _read(**row)
    for row in json.loads(Path(__file__).with_name("channels.json").read_bytes())
}
