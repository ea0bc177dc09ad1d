"""How the team reads a condition.

Every robot may set a condition. Over all authors the value with the greatest (revision, stamp,
author) stands. A condition that nobody has set has its declared default.
"""

from __future__ import annotations

from mrbt_mesh.core.facts.records import ConditionValue
from mrbt_mesh.core.mission.mission import Mission


class Conditions:
    """The conditions of one mission, as the team's entries say."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._by_author: dict[str, dict[str, ConditionValue]] = {}
        self._standing: dict[str, ConditionValue] = {}
        # Read at every tick: standing values, and defaults that were asked for.
        self._values: dict[str, bool] = {}
        self._defaults: dict[str, bool] = {}

    def set(self, name: str, author: str, value: ConditionValue) -> None:
        """What an author says from now on. Conditions are never dropped."""
        values = self._by_author.setdefault(name, {})
        values[author] = value
        _, _, winner = max((each.revision, each.stamp, by) for by, each in values.items())
        self._standing[name] = values[winner]
        self._values[name] = values[winner].value

    def value(self, name: str) -> bool:
        """Whether the condition holds."""
        value = self._values.get(name)
        if value is None:
            value = self._values[name] = self._default(name)
        return value

    def revision(self, name: str) -> int:
        """How often the condition has changed."""
        standing = self._standing.get(name)
        return standing.revision if standing is not None else 0

    def turns(self, name: str, value: bool) -> int:
        """How often the condition has turned to `value`."""
        standing = self._standing.get(name)
        return self.turns_at(name, value, standing.revision) if standing is not None else 0

    def turns_at(self, name: str, value: bool, revision: int) -> int:
        """The same at any revision: a boolean alternates, from its default on."""
        return revision // 2 if value == self._default(name) else (revision + 1) // 2

    def names(self) -> list[str]:
        """The conditions that somebody has set."""
        return list(self._standing)

    def _default(self, name: str) -> bool:
        default = self._defaults.get(name)
        if default is None:
            default = self._defaults[name] = self._mission.condition_default(name)
        return default
