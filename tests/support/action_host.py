"""What is around a program whose actions are run without an agent."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.inputs import Input, TreeTicked
from mrbt_mesh.sim.world.clock import VirtualClock


class Host:
    """Keeps what the runner says; `ticked`: the statuses of trees, which are for people. Without a
    clock it is always the same time.
    """

    def __init__(self, clock: VirtualClock | None = None) -> None:
        self.clock = clock
        self.said: list[Input] = []
        self.ticked: list[bytes] = []
        self.logged: list[dict[str, Any]] = []
        # Blackboard entries, with the jobs that own them.
        self.values: dict[tuple[str, str], Any] = {}

    def submit(self, event: Input) -> None:
        if isinstance(event, TreeTicked):
            self.ticked.append(event.statuses)
        else:
            self.said.append(event)

    def take_news(self) -> None:
        pass

    def may_step(self) -> bool:
        return True

    def read_condition(self, name: str) -> bool:
        return False

    def read_value(self, name: str, job: str) -> Any:
        return self.values.get((name, job))

    def record_event(self, event: Any) -> None:
        raise AssertionError(event)

    def unix_time_s(self) -> float:
        return self.clock.now_us / 1e6 if self.clock is not None else 0.0

    def log(self, level: str, event: str, **fields: Any) -> None:
        self.logged.append({"level": level, "event": event, **fields})
