"""The states of a map's places as a robot knows them: by its own facts and plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.store import Change, Incarnation
from mrbt_mesh.core.observer.task_log import TaskLog
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.formats.mission_map import place_states, told_places


class PlaceWatch:
    """Follows one robot, if its mission's map tells of places at all."""

    def __init__(self, view: AgentView) -> None:
        self._view = view
        self._tasks = TaskLog(view.mission)
        self._places = told_places(view.mission)
        self._has_changed = bool(self._places)
        if self._places:
            for entry in view.facts.map:
                self._tasks.fact(entry)
            view.facts.map.subscribe(self._facts)
            view.subscribe_to_plans(self._planned)

    def _facts(self, changes: Sequence[Change]) -> None:
        """A plan follows, if anything does."""
        for _, new in changes:
            if new is not None:
                self._tasks.fact(new)

    def _planned(self, plan: Plan, alive: Mapping[str, Incarnation]) -> None:
        self._has_changed = True
        self._tasks.plan(plan)

    def news(self) -> dict[str, str] | None:
        """Place -> state, or None where nothing can have changed since."""
        if not self._has_changed:
            return None
        self._has_changed = False
        return place_states(self._places, self._view.facts, self._tasks.has_succeeded)
