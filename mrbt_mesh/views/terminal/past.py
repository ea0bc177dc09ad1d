"""What was, robot by robot: the items of the view model's timeline, ready to be drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.observer.run_record import RunRecord
from mrbt_mesh.views.model.changes import ChangeLog
from mrbt_mesh.views.model.timeline import TimelineView

Item = dict[str, Any]


class Past:
    """Keeps the items `work/N`, `fault/N` and `loss/N` by robot, in their order."""

    def __init__(self) -> None:
        self.faults: dict[int, Item] = {}
        self.losses: dict[int, Item] = {}
        # Robot -> its works by number, in the order of their claims.
        self._works: dict[str, dict[int, Item]] = {}

    def take(self, items: Mapping[str, Any]) -> None:
        """Changes of a `ChangeLog`; others than those of the timeline are passed over."""
        for key, item in items.items():
            kind, _, number = key.partition("/")
            if kind == "work":
                self._works.setdefault(item["robot"], {})[int(number)] = item
            elif kind == "fault":
                self.faults[int(number)] = item
            elif kind == "loss":
                self.losses[int(number)] = item

    def works(self, robot: str, from_s: float) -> list[Item]:
        """Its works that had not ended by `from_s`, oldest first."""
        found = []
        for item in reversed(self._works.get(robot, {}).values()):
            if item["ended_s"] is not None and item["ended_s"] < from_s:
                break
            found.append(item)
        return found[::-1]


class RecordedPast:
    """Follows a record; another record, as after a leap backwards in a replay, begins anew."""

    def __init__(self) -> None:
        self._record: RunRecord | None = None

    def of(self, record: RunRecord) -> Past:
        """The past of this record, up to date."""
        if record is not self._record:
            self._record, self._version = record, 0
            self._log, self._view, self._past = ChangeLog(), TimelineView(record), Past()
        self._view.put(self._log)
        self._past.take(self._log.since(self._version))
        self._version = self._log.version
        return self._past
