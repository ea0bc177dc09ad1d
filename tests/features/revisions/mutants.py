"""Deliberate bugs of the feature: each must break its invariant."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.planning import make_plan
from mrbt_mesh.features.revisions.reviser import Reviser


def _without_revision(plan: Any, *given: Any, **named: Any) -> Any:
    return plan(*given, **named | {"mission_number": 0})


MUTANTS = {
    # A robot begins things while others act by another revision, or hold one that is not in force.
    "revisions_are_not_waited_for": [
        (Reviser, "may_begin", lambda *_: True),
        (make_plan, "Plan", _without_revision),
    ],
}
