"""What a mission says of tasks whose robots work jointly: together, and perhaps at most once."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mrbt_mesh.core.feature import JointPolicy

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import GlobalTask


class InDoubtPolicy(enum.StrEnum):
    """An exclusive task that was begun and ended without an outcome: it is held for the operator,
    counts as failed, or is tried again.
    """

    HOLD = "hold"
    FAIL = "fail"
    RETRY = "retry"


@dataclass(frozen=True, slots=True)
class CoalitionFields(JointPolicy):
    """What a mission says of a task that coalitions carry out, whose robots all start together.

    `simultaneous`: only the successes of one coalition count whose members began within
    `begin_within_us` (None: the detection time). `exclusive`: it is never done by two coalitions at
    the same time, nor again after it was done or left `in_doubt`.
    """

    simultaneous: bool = False
    exclusive: bool = False
    in_doubt: InDoubtPolicy = InDoubtPolicy.HOLD
    begin_within_us: int | None = None

    def problem(self) -> str:
        if self.begin_within_us is not None and self.begin_within_us <= 0:
            return "begin_within"
        # Robots that work each on its own have no coalitions.
        return "" if self.simultaneous or self.exclusive else "coalitions"

    @property
    def at_most_once(self) -> bool:
        return self.exclusive

    @property
    def why_unscheduled(self) -> str:
        return "it is exclusive" if self.exclusive else ""


def policy_of(task: GlobalTask | None) -> CoalitionFields | None:
    """How coalitions carry out a task; None if its robots work each on its own."""
    joint = task.joint if task is not None else None
    return joint if isinstance(joint, CoalitionFields) else None


def is_simultaneous(task: GlobalTask | None) -> bool:
    """Whether the robots of a task start together."""
    policy = policy_of(task)
    return policy is not None and policy.simultaneous


def in_doubt_policy(task: GlobalTask | None) -> InDoubtPolicy:
    """What becomes of a task that was begun and ended without an outcome."""
    policy = policy_of(task)
    return policy.in_doubt if policy is not None else InDoubtPolicy.HOLD
