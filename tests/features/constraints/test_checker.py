"""What the checker takes for allowed, written down case by case."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.planning.plan import RobotAssignment
from mrbt_mesh.features.constraints.checker import allowed, limited
from mrbt_mesh.features.constraints.kinds import AtMost, Constraint, NeverTogether, NotAtOnce


@pytest.mark.parametrize(
    ("constraint", "doers", "is_allowed"),
    [
        (AtMost(("A", "B", "C"), 2), {"A": "lift", "B": "look", "D": "lift"}, True),
        (AtMost(("A", "B", "C"), 2), {"A": "lift", "B": "look", "C": "lift"}, False),
        (NeverTogether(("A", "B")), {"A": "lift", "B": "look"}, True),
        (NeverTogether(("A", "B")), {"A": "lift(1)", "B": "lift(1)"}, False),
        (NeverTogether(("A", "B")), {"A": "lift(1)", "B": "lift(2)"}, True),
        (NeverTogether(("A", "B"), ("lift",)), {"A": "lift(1)", "B": "lift(1)"}, False),
        (NeverTogether(("A", "B"), ("look",)), {"A": "lift(1)", "B": "lift(1)"}, True),
        (NotAtOnce(("carry", "clean"), 1), {"A": "lift", "B": "lift"}, True),
    ],
)
def test_robots_on_one_global_task(
    constraint: Constraint, doers: dict[str, str], is_allowed: bool
) -> None:
    assert allowed(constraint, doers) is is_allowed


@pytest.mark.parametrize(
    ("constraint", "counted"),
    [
        (AtMost(("A", "C"), 1), ["AC"]),
        (NeverTogether(("A", "B", "C")), ["AB", "C"]),
        (NeverTogether(("A", "B", "C"), ("look",)), ["C"]),
        (NotAtOnce(("carry(1)",), 1), ["AB"]),
        (NotAtOnce(("carry",), 1), ["ABC"]),
    ],
)
def test_assignments_that_count_together(constraint: Constraint, counted: list[str]) -> None:
    plan = {
        "A": RobotAssignment("A", "1", "carry(1)", "lift(1)", 1, True),
        "B": RobotAssignment("B", "1", "carry(1)", "lift(1)", 1, False),
        "C": RobotAssignment("C", "2", "carry(2)", "look", 1, False),
        "D": RobotAssignment("D", "3", "clean", "look", 1, False),
    }
    assert ["".join(found) for found in limited(constraint, plan)] == counted
