"""What is around a program whose actions are run without an agent."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.sim.engine.clock import VirtualClock


class Host:
    """Keeps what the runner says. Without a clock it is always the same time."""

    def __init__(self, clock: VirtualClock | None = None) -> None:
        self.clock = clock
        self.said: list[Input] = []
        self.logged: list[dict[str, Any]] = []

    def submit(self, event: Input) -> None:
        self.said.append(event)

    def read_condition(self, name: str) -> bool:
        return False

    def record_event(self, event: Any) -> None:
        raise AssertionError(event)

    def unix_time_s(self) -> float:
        return self.clock.now_us / 1e6 if self.clock is not None else 0.0

    def log(self, level: str, event: str, **fields: Any) -> None:
        self.logged.append({"level": level, "event": event, **fields})
