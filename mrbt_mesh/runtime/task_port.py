"""Implements a task's context: checks the program's reports and passes them to the agent."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Mapping
from numbers import Real
from typing import TYPE_CHECKING, Any, Protocol

from mrbt_mesh.core.agent.inputs import (
    CapabilityChanged,
    ConditionSet,
    Input,
    PerformanceChanged,
    PositionReported,
    ProgressReported,
    TreeTicked,
)
from mrbt_mesh.core.membership.wire import MAX_COORDINATE, Position
from mrbt_mesh.core.mission.conditions import Value, truth_of
from mrbt_mesh.core.mission.mission import Mission, micro_performance
from mrbt_mesh.core.mission.names import declared_name
from mrbt_mesh.runtime.user_code import outside, shown

if TYPE_CHECKING:
    from mrbt_mesh.features.values.blackboard import ValueType

CONDITIONS_PER_OUTCOME = 1_000


class Host(Protocol):
    """What an action needs from its runtime."""

    def submit(self, event: Input) -> None:
        """Pass an input to the agent; may only be called from the event loop."""
        ...

    def take_news(self) -> None:
        """Process what other robots have sent."""
        ...

    def may_step(self) -> bool:
        """Return whether the program may continue with its local task."""
        ...

    def read_condition(self, name: str) -> bool: ...
    def read_value(self, name: str, job: str) -> Value | None: ...
    def record_event(self, event: Mapping[str, Any]) -> None: ...
    def unix_time_s(self) -> float: ...
    def log(self, level: str, event: str, **fields: Any) -> None: ...


def milli_position(x: float, y: float, heading: float | None) -> Position:
    """Return a position in thousandths, with the heading reduced to one turn. Raises ValueError."""
    most = MAX_COORDINATE // 1_000
    for number in (x, y, 0.0 if heading is None else heading):
        if isinstance(number, bool) or not isinstance(number, Real):
            raise ValueError(f"a position consists of numbers, not {shown(number)}")
        if not -most <= number <= most:
            raise ValueError(
                f"a position consists of numbers from {-most} to {most}, not {shown(number)}"
            )
    turned = None if heading is None else round(math.remainder(heading, math.tau) * 1_000)
    return Position(round(float(x) * 1_000), round(float(y) * 1_000), turned)


def truth(value: Any, what: str) -> bool:
    """Return a bool, also of numpy's; raises ValueError for any other value of `what`."""
    found = truth_of(value)
    if found is None:
        raise ValueError(f"{what} is set to True or False, not {shown(value)}")
    return found


class AgentPort:
    """Implements one TaskContext; collects the conditions that are reported with the outcome.

    `renew_travel_times` is called when the program says that they have changed. `job`: the job that
    the task belongs to, if any. `conditions` also holds other blackboard entries.
    """

    def __init__(
        self,
        host: Host,
        mission: Mission,
        ticket: int | None,
        renew_travel_times: Callable[[], None],
        job: str = "",
    ) -> None:
        self._host = host
        self._mission = mission
        self._ticket = ticket
        self._renew_travel_times = renew_travel_times
        self._job = job
        self._thread = threading.get_ident()
        self._is_over = False
        self.conditions: dict[str, Value | None] = {}
        self._tree_statuses = b""

    def close(self) -> None:
        """End the local task: nothing can be added to its outcome any more."""
        self._is_over = True

    def set_condition(self, name: str, value: bool, at_once: bool) -> None:
        self.check_condition(name)
        holds = truth(value, f"condition {name!r}")
        if at_once or self._ticket is None:
            self._submit(ConditionSet(name, holds))
        else:
            self._keep(name, holds)

    def check_condition(self, name: str) -> None:
        """Raise ValueError unless this is a condition that the program may set."""
        if isinstance(name, str) and self._mission.entries.is_value(name):
            raise ValueError(f"{name!r} is a blackboard entry, not a condition: use set_value")
        if not isinstance(name, str) or not self._mission.entries.knows(name):
            declared = ", ".join(sorted(self._mission.truths)) or "none"
            raise ValueError(f"condition {shown(name)} is not declared in the mission ({declared})")
        if self._mission.is_failure_reason(name):
            text = "is a reason of failures: fail with such a reason instead"
            raise ValueError(f"condition {name!r} {text}")

    def set_value(self, name: str, value: Any, at_once: bool) -> None:
        known = self.check_entry(name)
        found = None if value is None else self._typed(known, name, value)
        if at_once or self._ticket is None:
            self._submit(ConditionSet(name, found, self._job))
        else:
            self._keep(name, found)

    def _typed(self, known: ValueType, name: str, value: Any) -> Value:
        try:
            return known.value(value, is_rounded=True)
        except ValueError as error:
            raise ValueError(f"{name} is not set: {error}") from None

    def check_entry(self, name: str) -> ValueType:
        """Return the type of a blackboard entry.

        Raises ValueError unless the program may use it here.
        """
        # Loaded only by programs that use entries.
        from mrbt_mesh.features.values.traits import traits_of

        mission = self._mission
        known = mission.conditions.get(declared_name(name)) if isinstance(name, str) else None
        values = traits_of(known).values if known is not None else None
        if known is None or values is None or not mission.entries.knows(name):
            declared = ", ".join(sorted(mission.conditions.keys() - mission.truths.keys()))
            text = f"{shown(name)} is not an entry of the mission's blackboard"
            raise ValueError(f"{text} ({declared or 'it has none'})")
        if traits_of(known).per_job and not self._job:
            raise ValueError(f"each job has its own {name}, and this is not a task of a job")
        return values

    def read_value(self, name: str) -> str | int | float | None:
        known = self.check_entry(name)
        value = self.conditions.get(name, self._host.read_value(name, self._job))
        return value / 10**known.decimals if known.decimals and value is not None else value

    def set_conditions(self, values: Mapping[str, Any]) -> None:
        """Set conditions and other entries with the outcome, all or none."""
        told: dict[str, Value | None] = {}
        for name, value in values.items():
            if isinstance(name, str) and self._mission.entries.is_value(name):
                told[name] = self._typed(self.check_entry(name), name, value)
            else:
                self.check_condition(name)
                told[name] = truth(value, f"condition {name!r}")
        for name, kept in told.items():
            self._keep(name, kept)

    def _keep(self, name: str, value: Value | None) -> None:
        """Keep a condition or entry until the outcome is reported."""
        if self._is_over:
            raise RuntimeError(f"{name!r} is set after the local task has ended: use at_once=True")
        self.conditions[name] = value
        if len(self.conditions) > CONDITIONS_PER_OUTCOME:
            raise ValueError(f"more than {CONDITIONS_PER_OUTCOME} conditions set by one local task")

    def read_condition(self, name: str) -> bool:
        return bool(self.conditions.get(name, self._host.read_condition(name)))

    def report_progress(self, fraction: float) -> None:
        is_number = isinstance(fraction, Real) and not isinstance(fraction, bool)
        if not is_number or fraction != fraction or abs(fraction) == math.inf:
            raise ValueError(f"progress is a number from 0 to 1, not {shown(fraction)}")
        if self._ticket is not None:
            percent = round(max(0.0, min(1.0, float(fraction))) * 100)
            self._submit(ProgressReported(self._ticket, percent))

    def report_tree(self, statuses: bytes) -> None:
        """Report a tick of the tree that is the action: the statuses of its nodes in preorder."""
        if self._ticket is not None and statuses != self._tree_statuses:
            self._tree_statuses = statuses
            self._submit(TreeTicked(self._ticket, statuses))

    def report_position(self, x: float, y: float, heading: float | None) -> None:
        self._submit(PositionReported(milli_position(x, y, heading)))

    def lose_capability(self, local_task: str, reason: str, is_watched: bool = False) -> None:
        why = _reason(reason) or "no reason given"
        self._submit(CapabilityChanged(local_task, True, why, is_watched=is_watched))

    def defer_capability(self, local_task: str, reason: str) -> None:
        why = _reason(reason)
        self._submit(CapabilityChanged(local_task, True, why, is_pending=True))

    def restore_capability(self, local_task: str) -> None:
        self._submit(CapabilityChanged(local_task, lost=False))

    def report_performance(self, local_task: str, performance: float) -> None:
        micro = micro_performance(performance)
        self._submit(PerformanceChanged(local_task, micro))

    def update_travel_times(self) -> None:
        self._check_thread()
        self._renew_travel_times()

    def record_event(self, event: Mapping[str, Any]) -> None:
        try:
            json.dumps(dict(event), allow_nan=False)
        except (TypeError, ValueError) as error:
            raise ValueError(f"an event has to be JSON: {error}") from None
        self._host.record_event(event)

    def unix_time_s(self) -> float:
        return self._host.unix_time_s()

    def _submit(self, event: Input) -> None:
        self._check_thread()
        outside(self._host.submit, event)

    def _check_thread(self) -> None:
        if threading.get_ident() != self._thread:
            raise RuntimeError(
                "a task's context is used from another thread: call it with "
                "anyio.from_thread.run_sync or loop.call_soon_threadsafe"
            )


def _reason(reason: Any) -> str:
    if not isinstance(reason, str):
        raise ValueError(f"a reason is a text, not {shown(reason)}")
    return reason
