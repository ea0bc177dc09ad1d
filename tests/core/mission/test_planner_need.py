"""Which missions need the extra `planner`: that follows from the mission alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.mission.planner_need import planner_need, planner_problem
from mrbt_mesh.features.constraints.kinds import SECTION, AtMost
from mrbt_mesh.formats.mission_file import load_mission
from tests.support.paths import mission_file

REPAIR = load_mission(mission_file("vehicle_repair"))
DELIVERIES = load_mission(mission_file("deliveries"))
LIMITED = replace(REPAIR, sections={SECTION: (AtMost(("A1", "A2"), 1),)})
LARGE = replace(REPAIR, robots={f"R{number}": REPAIR.robots["A1"] for number in range(40)})


def test_a_small_mission_needs_nothing() -> None:
    assert planner_need(REPAIR) == ""
    assert planner_problem(REPAIR, lacks_planner=True) == ""


@pytest.mark.parametrize(
    ("mission", "named", "need"),
    [
        (LIMITED, None, "with its side constraints"),
        (replace(REPAIR, solver="cp_sat"), None, "with the solver 'cp_sat'"),
        (REPAIR, "my:own", "with the solver 'my:own'"),
        (LARGE, None, "with 40 robots and up to 24 local tasks at the same time"),
        (DELIVERIES, None, "with 6 robots and up to 60 local tasks at the same time"),
    ],
)
def test_others_need_it_for_a_reason(mission: object, named: str | None, need: str) -> None:
    assert planner_need(mission, named) == need  # type: ignore[arg-type]
    problem = planner_problem(mission, True, named)  # type: ignore[arg-type]
    assert problem.endswith(f"{need} needs the extra 'planner': pip install 'mrbt-mesh[planner]'")
    assert planner_problem(mission, False, named) == ""  # type: ignore[arg-type]
