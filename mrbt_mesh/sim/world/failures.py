"""Failure models: robots that die and lose capabilities by chance, and actions that fail.

Where a schedule says what happens when, a model says how likely it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.core.mission.mission import Mission, Robot

EVERYBODY = ""


@dataclass(frozen=True, slots=True)
class Rate:
    """How often there is a fault of a robot: with a chance (0 to 1) each time it completes an
    action, and so many times per hour on the average, at times that know nothing of each other.
    """

    per_action: float = 0.0
    per_hour: float = 0.0


@dataclass(frozen=True)
class FailureModel:
    """What goes wrong how often.

    `major` (death) and `minor` (a capability is lost, any of those that are left alike) map a
    robot, a robot type or EVERYBODY to a rate; the most specific one counts. `actions` maps a
    local-task type or EVERYBODY to the chance that the action fails. `major_faults` different
    robots die, and `minor_faults` different capabilities of robots are lost, at random times
    within the first `within_us`. `return_us` after its death a robot is started again with its
    journal, `repair_us` after its loss a capability is back; None: never.
    """

    major: Mapping[str, Rate] = field(default_factory=dict)
    minor: Mapping[str, Rate] = field(default_factory=dict)
    actions: Mapping[str, float] = field(default_factory=dict)
    major_faults: int = 0
    minor_faults: int = 0
    within_us: int = 0
    return_us: int | None = None
    repair_us: int | None = None


NO_FAILURES = FailureModel()


def rate_of(rates: Mapping[str, Rate], robot: Robot) -> Rate:
    """The rate that counts for a robot."""
    for name in (robot.id, robot.type, EVERYBODY):
        if name in rates:
            return rates[name]
    return Rate()


def losable(mission: Mission) -> list[tuple[str, str]]:
    """All (robot, capability) pairs that minor faults can take away, sorted."""
    return [
        (r.id, name) for _, r in sorted(mission.robots.items()) for name in sorted(r.capabilities)
    ]
