"""What a mission says of tasks whose robots work jointly: together, and perhaps at most once."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

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

    @classmethod
    def from_json(cls, data: Sequence[Any]) -> Self | None:
        """The inverse of `to_json`; None for robots that work each on its own."""
        simultaneous, exclusive, in_doubt, begin_within_us = data
        policy = cls(simultaneous, exclusive, InDoubtPolicy(in_doubt), begin_within_us)
        if simultaneous or exclusive:
            return policy
        if policy != cls():
            raise ValueError("robots that work each on its own have no coalitions")
        return None

    def to_json(self) -> list[Any]:
        return [self.simultaneous, self.exclusive, str(self.in_doubt), self.begin_within_us]

    def problem(self) -> str:
        within_us = self.begin_within_us
        if within_us is not None and (type(within_us) is not int or within_us <= 0):
            return "begin_within"
        flags = {"simultaneous": self.simultaneous, "exclusive": self.exclusive}
        return next((name for name, flag in flags.items() if not isinstance(flag, bool)), "")

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
