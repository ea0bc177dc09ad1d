"""Counts what was refused from outside; each source and reason is worth one line in the log."""

from __future__ import annotations

MAX_KEPT = 1_000


class Refusals:
    """How often what was refused. Beyond `MAX_KEPT` different ones, new ones are only summed."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.others = 0

    def count(self, source: str, reason: str) -> bool:
        """Count one; True if it is the first of its kind."""
        key = f"{source}: {reason}"
        if key not in self.counts and len(self.counts) >= MAX_KEPT:
            self.others += 1
            return False
        self.counts[key] = self.counts.get(key, 0) + 1
        return self.counts[key] == 1
