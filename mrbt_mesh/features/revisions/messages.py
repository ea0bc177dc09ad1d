"""What a robot asks its program about a revision, and the answer; and what operators ask robots."""

from __future__ import annotations

from dataclasses import dataclass, field

from mrbt_mesh.core.agent.effects import FeatureEffect
from mrbt_mesh.core.agent.inputs import FeatureInput
from mrbt_mesh.core.mission.mission import Mission

# The word with which an operator asks a robot if its program could do a compiled mission.
CHECK_REVISION = "check_revision"


@dataclass(frozen=True, slots=True)
class CheckMission(FeatureEffect):
    """Check whether the robot's program can do what a revision of the mission asks of this robot.
    Answered by MissionChecked.
    """

    mission: Mission = field(repr=False)


@dataclass(frozen=True, slots=True)
class MissionChecked(FeatureInput):
    """Why the robot's program cannot do what the revision of this digest asks for, or empty."""

    digest: str
    problem: str
