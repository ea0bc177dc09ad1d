"""What a robot had that is gone: its per-robot conditions become false.

As with verdicts (`verdicts`), who is alive is no part of what a tree reads. But what a dead robot
held is lost to the team, and another one may have to fetch it again. So once the plan has said for
the time of a verdict that a robot is no part of the team, and all report the same plan, its own
conditions are set to false, by whoever sees the time pass first; all write the same. A robot that
comes back tells its own again (`agent.reports`).
"""

from __future__ import annotations

from collections.abc import Collection

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.names import robot_condition
from mrbt_mesh.core.planning.plan import PendingLoss


def pending_losses(facts: TeamFacts, team: Collection[str]) -> tuple[PendingLoss, ...]:
    """What holds for robots of the mission that are not in the team, sorted."""
    mission = facts.mission
    gone = sorted(robot for robot in mission.robots if robot not in team)
    names = (robot_condition(leaf, robot) for leaf in mission.per_robot.leaves for robot in gone)
    return tuple(
        PendingLoss(name, facts.conditions.revision(name) + 1)
        for name in names
        if facts.condition(name)
    )
