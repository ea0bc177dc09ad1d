"""What may be written at a node of the XML, in the words of a team file.

`_reads="map; door(1)"`, `_writes`, `_uses`, `_requires="door_open(1); !dark"`, `_effects`,
`_may_fail="true"`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.team_file import TeamFile

LISTS = {"_reads": "reads", "_writes": "writes", "_uses": "uses"}
VALUES = {"_requires": "requires", "_effects": "effects"}
MAY_FAIL = "_may_fail"


def annotated(
    known: Declaration | None, attributes: Mapping[str, str], team: TeamFile
) -> Declaration | None:
    """The declaration of an action in the team file, with the annotations of its node."""
    if not {*LISTS, *VALUES, MAY_FAIL} & attributes.keys():
        return known
    known = known or Declaration()
    changes: dict[str, Any] = {}
    for attribute, name in LISTS.items():
        if attribute in attributes:
            changes[name] = getattr(known, name) | frozenset(_items(attributes[attribute]))
    for attribute, name in VALUES.items():
        if attribute in attributes:
            values = {t.lstrip("! "): not t.startswith("!") for t in _items(attributes[attribute])}
            changes[name] = {**getattr(known, name), **values}
    if MAY_FAIL in attributes:
        changes["may_fail"] = known.may_fail or bool(read_boolean(attributes[MAY_FAIL]))
    found = replace(known, **changes)
    return replace(found, uses=team.shared(found.uses))


def annotated_names(attributes: Mapping[str, str]) -> Iterator[tuple[str, str, bool | None]]:
    """The key of a team file, the name without arguments, and the value that an effect gives it."""
    for attribute, key in {**LISTS, **VALUES}.items():
        for text in _items(attributes.get(attribute, "")):
            value = not text.startswith("!") if key == "effects" else None
            yield key, type_name(text.lstrip("! ")), value


def _items(text: str) -> Iterable[str]:
    return (item.strip() for item in text.split(";") if item.strip())
