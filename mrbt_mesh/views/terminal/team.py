"""A team as the terminal knows it: the items of its view model, sorted by what they are of."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.views.model.mission_view import mission_view
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.terminal.lanes import Past


class ShownTeam:
    """Follows an observer by its `TeamView`, whose docstring names the items."""

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.mission = mission_view(observer.mission)
        self.past = Past()
        self.team: dict[str, Any] = {}
        self.robots: dict[str, dict[str, Any]] = {}
        self.nodes: dict[int, list[Any]] = {}
        # Takeovers, explained as they were.
        self.takeovers: dict[int, dict[str, Any]] = {}
        self.now_s = 0.0
        self._view = TeamView(observer)
        self._version = 0

    def update(self, now_us: int) -> bool:
        """Look at the observer, which is up to date; whether anything has changed."""
        record = self.observer.record
        self.now_s = record.seconds(record.ended_us or now_us) or 0.0
        self._view.update(now_us)
        items = self._view.changes.since(self._version)
        self._version = self._view.changes.version
        self.past.take(items)
        for key, value in items.items():
            kind, _, name = key.partition("/")
            match kind:
                case "team":
                    self.team = value
                case "robot":
                    self.robots[name] = value
                case "node":
                    self.nodes[int(name)] = value
                case "why":
                    self.takeovers[int(name)] = value
        return bool(items)

    def takeover_of(self, robot: str) -> dict[str, Any] | None:
        """The latest takeover of its work, or by it, explained."""
        for number, fault in sorted(self.past.faults.items(), reverse=True):
            if robot in (fault["robot"], fault["replacement"]) and number in self.takeovers:
                return self.takeovers[number]
        return None
