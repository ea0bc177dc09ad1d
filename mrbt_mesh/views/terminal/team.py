"""A team for the terminal: the items of its view model, sorted by kind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.mission_view import mission_view
from mrbt_mesh.views.model.team_view import Shown

Item = dict[str, Any]
_NUMBERED = ("node", "work", "fault", "loss", "event", "why")


class ShownTeam:
    """Keeps the items of a view.

    `now_s`: the current time in seconds from the start of the run. `unix_us`: the time by the
    team's clocks; None: not known.
    """

    def __init__(self, view: Shown) -> None:
        self.view = view
        self.mission = mission_view(view.observer.mission)
        self.now_s = 0.0
        self.unix_us: int | None = None
        self._version = 0
        self._items: dict[str, dict[Any, Any]] = defaultdict(dict)
        # Robot -> its works by number, in the order of their claims.
        self._works: dict[str, dict[int, Item]] = {}

    @property
    def observer(self) -> Observer:
        """The team as currently shown."""
        return self.view.observer

    @property
    def team(self) -> Item:
        """The item `team`; it exists after the first update."""
        item: Item = self._items["team"][""]
        return item

    @property
    def headline(self) -> list[Item]:
        """The item `headline`; it exists after the first update."""
        item: list[Item] = self._items["headline"][""]
        return item

    @property
    def forecast(self) -> Item | None:
        """The item `forecast`, if there is one."""
        return self._items["forecast"].get("")

    @property
    def expected_end_s(self) -> float:
        """When the schedule in force ends; now if there is none."""
        forecast = self.forecast
        if forecast is None or forecast["ends_s"] is None:
            return self.now_s
        return max(self.now_s, float(forecast["at_s"] + forecast["ends_s"]))

    @property
    def robots(self) -> dict[str, Item]:
        """The items `robot/ID`."""
        return self._items["robot"]

    @property
    def nodes(self) -> dict[int, list[Any]]:
        """The items `node/N`."""
        return self._items["node"]

    @property
    def jobs(self) -> dict[str, Item]:
        """The items `job/ID`."""
        return self._items["job"]

    @property
    def losses(self) -> list[Item]:
        """The capabilities that robots have lost."""
        return self._until_now("loss")

    @property
    def faults(self) -> list[Item]:
        """The deaths."""
        return self._until_now("fault")

    @property
    def events(self) -> list[Item]:
        """What happened."""
        return self._until_now("event")

    def _until_now(self, kind: str) -> list[Item]:
        """Return the items up to now: a recording has those of the whole run."""
        items = self._items[kind].values()
        return [each for each in items if (each["at_s"] or 0.0) <= self.now_s]

    def update(self, now_us: int) -> bool:
        """Update from the observer, which must be up to date.

        Return whether anything has changed.
        """
        self.view.update(now_us)
        since = self.view.changes.start_of(self._version)
        if since == 0:
            self._items.clear()
        changed = self.view.changes.since(since)
        self._version = self.view.changes.version
        ended_us = self.observer.record.ended_us
        self.now_s = self.view.seconds(now_us if ended_us is None else ended_us) or 0.0
        ahead_us = self.observer.clock_ahead_us()
        self.unix_us = None if ahead_us is None else now_us + ahead_us
        self.take(changed)
        if self.mission["revision"] != self.team["revision"]:
            self.mission = mission_view(self.observer.mission)
        return bool(changed)

    def take(self, changed: Mapping[str, Any]) -> None:
        """Apply items by key; None removes one."""
        for key, value in changed.items():
            kind, _, name = key.partition("/")
            place = int(name) if kind in _NUMBERED else name
            if value is None:
                self._items[kind].pop(place, None)
            elif kind == "work":
                self._works.setdefault(value["robot"], {})[int(name)] = value
            else:
                self._items[kind][place] = value
        if "older" in changed:
            self._drop_older(changed["older"])

    def _drop_older(self, older: Mapping[str, tuple[int, list[int]]]) -> None:
        """Forget what the view no longer keeps."""
        for kind, items in (
            ("event", self._items["event"]),
            *(("work", works) for works in self._works.values()),
        ):
            first, kept = older[kind]
            for number in [each for each in items if each < first and each not in kept]:
                del items[number]

    @property
    def older_events(self) -> int:
        """The number of events before the oldest one that is kept."""
        first, _ = self._items["older"].get("", {}).get("event", (0, ()))
        return int(first)

    def works(self, robot: str, from_s: float) -> list[Item]:
        """Return a robot's works that had begun by now and not ended by `from_s`, oldest first."""
        found = []
        for item in reversed(self._works.get(robot, {}).values()):
            if item["ended_s"] is not None and item["ended_s"] < from_s:
                break
            if (item["claimed_s"] or 0.0) <= self.now_s:
                found.append(item)
        return found[::-1]

    def takeover_of(self, robot: str) -> Item | None:
        """Return the explanation of the latest takeover of the robot's work, or by it, as it was
        then.
        """
        explained: dict[int, Item] = self._items["why"]
        for number, fault in sorted(self._items["fault"].items(), reverse=True):
            is_past = (fault["at_s"] or 0.0) <= self.now_s
            if is_past and number in explained and robot in (fault["robot"], fault["replacement"]):
                return explained[number]
        return None
