"""The changes of a map of facts in their order, with what else happened between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrbt_mesh.core.facts.store import Change, Entry, FactMap
from mrbt_mesh.recording.channels import DROPPED, FACTS
from mrbt_mesh.recording.packing import pack_fact


class FactLog:
    """`number`: how many changes there were; the facts that are there already come first.

    Messages are made when they are taken: the proof of a batch is complete only at its end.
    """

    def __init__(self, facts: FactMap) -> None:
        self.number = 0
        self._waiting: list[tuple[str, int, Any]] = []
        self._note([(None, entry) for entry in facts])
        facts.subscribe(self._note)

    def _note(self, changes: Sequence[Change]) -> None:
        for old, new in changes:
            self.number += 1
            if new is not None:
                self._waiting.append((FACTS, self.number, new))
            else:
                self._waiting.append((DROPPED, self.number, old))

    def add(self, topic: str, data: Mapping[str, Any]) -> None:
        """Put another message between the changes before and after it."""
        self._waiting.append((topic, 0, data))

    def take(self) -> list[tuple[str, Mapping[str, Any]]]:
        """(topic, message) of what has happened since; each is handed over once."""
        waiting, self._waiting = self._waiting, []
        return [(topic, _message(topic, number, what)) for topic, number, what in waiting]


def _message(topic: str, number: int, what: Any) -> Mapping[str, Any]:
    if topic == FACTS:
        return pack_fact(what, number)
    if topic == DROPPED and isinstance(what, Entry):
        return {"number": number, "author": what.author, "name": what.name}
    data: Mapping[str, Any] = what
    return data
