"""What more robots, and more capabilities, cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Costs:
    """What one more robot of a type costs, and one more robot that is capable of a local task.

    What is not listed costs 1. Only `mrbt analyze` reads it.
    """

    robots: Mapping[str, int] = field(default_factory=dict)
    capabilities: Mapping[str, int] = field(default_factory=dict)

    def robot(self, robot_type: str) -> int:
        """The cost of one more robot."""
        return self.robots.get(robot_type, 1)

    def capability(self, local_task: str) -> int:
        """The cost of making one robot capable."""
        return self.capabilities.get(local_task, 1)
