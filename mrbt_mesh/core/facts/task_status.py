"""When a global task has succeeded, and when it has failed.

This is the paper's *Perform Global Task g* (section V, definition of T_G): the status of the action
leaf, computed from the outcomes of its activation. Where the paper is silent or contradicts itself,
see docs/decisions. The status never depends on which robots seem alive: consequences of that are
latched as a failure, a fact, once all robots have agreed on them for some time
(`planning.pending_failures`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Protocol

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.activation_facts import ActivationFacts
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask, Mission, Need


class TeamMembers(Protocol):
    """What a task's failure depends on besides the outcomes."""

    @property
    def in_force(self) -> Mission: ...
    def robots_with(self, local_task: str) -> Collection[str]:
        """All known robots with the capability, including dead robots and robots that lost it."""
        ...

    def claimants(self, activation: str, local_task: str) -> Collection[str]:
        """The robots with a valid claim on this local task of this activation."""
        ...


def task_status(task: GlobalTask, said: ActivationFacts, team: TeamMembers) -> Status:
    """Return the status of a task's activation.

    Success takes precedence over failure, so a late success still counts, even after a latched
    failure. An operator's decision and a latched failure count like outcomes.
    """
    if has_succeeded(task, said):
        return Status.SUCCESS
    if said.has_latched_failure or has_failed(task, said, team):
        return Status.FAILURE
    return Status.RUNNING


def has_succeeded(task: GlobalTask, said: ActivationFacts) -> bool:
    """True if each local task has at least nu successes, of the same party if there are any."""
    if said.joint is not None:
        return said.joint.has_succeeded(task)
    return bool(said.outcomes) and are_enough(task, said.outcomes)


def are_enough(task: GlobalTask, outcomes: Mapping[str, Mapping[str, bool]]) -> bool:
    """True if each local task has at least nu of these successes."""
    return all(
        sum(outcomes.get(need.local_task, {}).values()) >= need.min_robots for need in task.needs
    )


def has_failed(task: GlobalTask, said: ActivationFacts, team: TeamMembers) -> bool:
    """True if one need has failed."""
    if said.joint is not None:
        return said.joint.has_failed(task, team)
    return any(_need_failed(task, need, said, team) for need in task.needs)


def _need_failed(task: GlobalTask, need: Need, said: ActivationFacts, team: TeamMembers) -> bool:
    """True if a robot has failed and the failure policy counts that as a failure of the need.

    - `first`: nu is above 0;
    - `paper`: failures exceed assigned - nu, where assigned = outcomes + valid claims;
    - others: successes and robots that may still try, dead or not, are fewer than nu.
    """
    results = said.outcomes.get(need.local_task, {})
    failures = sum(not success for success in results.values())
    if not failures or task.failure is FailurePolicy.FIRST:
        return failures > 0 and need.min_robots > 0
    if task.failure is FailurePolicy.PAPER:
        claimants = team.claimants(str(said.activation), need.local_task)
        assigned = len(results) + sum(robot not in results for robot in claimants)
        return failures > assigned - need.min_robots
    successes = len(results) - failures
    may_try = sum(robot not in results for robot in team.robots_with(need.local_task))
    return successes + may_try < need.min_robots
