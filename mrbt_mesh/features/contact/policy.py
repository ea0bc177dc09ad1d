"""What robots do that have lost contact."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission

# The name of the feature's section in a compiled mission.
SECTION = "on_lost_contact"
# The message with which an operator shows a robot that it is in contact.
ATTEND = "attend"

# One day.
MAX_CONTACT_US = 86_400_000_000
# The largest team in which all robots hear one another, with the default timing.
MAX_MAJORITY = 7


class ContactOf(enum.StrEnum):
    """Whom a robot has to hear: any robot, a majority, or an operator.

    A majority is one of the mission's robots, including the robot itself.
    """

    TEAM = "team"
    MAJORITY = "majority"
    OPERATOR = "operator"


class OnLostContact(enum.StrEnum):
    """What a robot does without contact.

    FINISH ends its task and begins no other; HOLD cancels it; RETURN cancels it and then performs a
    local task.
    """

    FINISH = "finish"
    HOLD = "hold"
    RETURN = "return"


@dataclass(frozen=True)
class LostContact:
    """What robots of a type do that have been without contact for `after_us`.

    `local_task` is the ground local task that RETURN performs, else empty.
    """

    after_us: int
    of: ContactOf
    then: OnLostContact
    local_task: str = ""

    @property
    def is_promise(self) -> bool:
        """True if other robots can rely on this robot having stopped."""
        return self.then is not OnLostContact.FINISH and self.of is not ContactOf.OPERATOR


def policies(mission: Mission) -> Mapping[str, LostContact]:
    """Return what robots do without contact, by robot type."""
    found: Mapping[str, LostContact] = mission.sections.get(SECTION, {})
    return found
