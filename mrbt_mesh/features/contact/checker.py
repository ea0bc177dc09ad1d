"""I12: robots that stop without contact have stopped before others begin in their place."""

from __future__ import annotations

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.mission.jobs import place_at
from mrbt_mesh.core.mission.mission import performance
from mrbt_mesh.features.contact.policy import ContactOf, policies
from mrbt_mesh.sim.checkers.feature_checker import FeatureChecker


class HasStopped(FeatureChecker):
    """I12: a robot never begins while a robot that it takes for dead still works there.

    This concerns exclusive tasks and tasks with a place, and robots that are capable of the task
    and hold or return without contact with a majority.
    """

    def started(self, agent: AgentView, start: StartAction) -> None:
        run = self.run
        mission, alive, place = (
            agent.mission,
            agent.alive(),
            place_at(agent.mission, start.local_task),
        )
        task = agent.facts.task_of(start.activation)
        is_exclusive = task is not None and task.at_most_once
        by_type = policies(mission)
        if not by_type or not (is_exclusive or place):
            return
        for process in run.world.living():
            other = process.agent.view if process.agent is not None else None
            if other is None or process.robot in alive:
                continue
            robot = mission.robots.get(process.robot)
            policy = by_type.get(robot.type) if robot is not None else None
            if policy is None or not policy.is_promise or policy.of is not ContactOf.MAJORITY:
                continue
            if robot is None or performance(robot.capabilities, start.local_task) is None:
                continue
            run.checks["I12"] += 1
            theirs = other.action
            if theirs is None or theirs.travel_to:
                continue
            is_there = place != "" and place_at(other.mission, theirs.local_task) == place
            if is_there or theirs.activation == start.activation:
                text = f"{agent.robot} begins {start.local_task} of {start.activation} while"
                run.violation(
                    "I12", f"{text} {process.robot}, without contact, is still at work there"
                )
