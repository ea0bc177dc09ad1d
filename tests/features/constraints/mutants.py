"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from mrbt_mesh.features.constraints.limits import ConstraintLimits

MUTANTS = {
    # The assignment problem has no side constraints; requests are still checked one by one.
    "assigned_without_constraints": (ConstraintLimits, "side_constraints", lambda *_: ()),
}
