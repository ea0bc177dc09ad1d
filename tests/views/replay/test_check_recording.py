"""Plans are made again with the mission in force where they were recorded."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.views.replay.check_recording import PlanAgain

FILE = """
mission: line
local_tasks: {weld: {work: 2}}
robot_types: {arm: {capabilities: {weld: 1}}}
robots: {A1: arm}
global_tasks: {%s: {needs: {weld: {min: 1}}}}
tree: {Sequence: [%s]}
"""


def test_launches_with_equal_facts_and_other_revisions_have_other_plans() -> None:
    began, later = (
        mission_from_yaml(FILE % (task, task), "line.yaml", Path()) for task in ("one", "two")
    )
    plans = PlanAgain(began)
    for mission in (began, later, began):
        plan = plans.plan(TeamFacts(mission, "run"), {})
        assert plan.evaluation.tree == mission.tree
