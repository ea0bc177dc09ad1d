"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from mrbt_mesh.features.values.plan import OwnStep

MUTANTS = {
    # Any free robot goes on with the work that one robot has begun for itself.
    "per_robot_conditions_are_anybodys": (OwnStep, "eligible", lambda *_: None),
}
