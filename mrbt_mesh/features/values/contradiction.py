"""A robot that contradicts others which took its conditions for lost."""

from __future__ import annotations

from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import ConditionValue
from mrbt_mesh.core.feature import Kit, Part


class Contradiction(Part):
    """Writes the robot's own conditions again if others, not hearing it, took them for lost."""

    def __init__(self, kit: Kit) -> None:
        self._context = kit.context

    def settle(self, now_us: int) -> None:
        context, facts = self._context, self._context.facts
        if context.is_leaving or context.me not in context.mission.robots:
            return
        changed: dict[str, ConditionValue] = {}
        for read in facts.mission.entries.read:
            name = context.mission.entries.of(context.me, read)
            value = context.last_word(name)
            if facts.conditions.entry(name) != value:
                changes = facts.conditions.changes(name) + 1
                changed[name] = ConditionValue(value, changes, facts.max_stamp + 1)
        if changed:
            written = [(f"{records.CONDITION}/{name}", value) for name, value in changed.items()]
            context.write(written, now_us)
