"""Which requests are about to fail because of the robots that are dead.

A global task's status never follows from who is thought alive, or a false suspicion would turn the
tree to a fallback and back (`facts.task_status`). But once a robot has failed, and no living robot
can make it good, waiting for the dead is in vain. Then the plan has a *pending failure*. When it
has had it for some time without a break, and all report the same plan, the failure is latched: it
is written as a fact (`planning.deadlines`) that holds for that activation, whichever robot returns.

Where no robot has failed, a request that no robot can serve is *blocked*, as its policy says. So is
one for which a `JointPolicy` has an obstacle.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.records import Member
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
from mrbt_mesh.core.planning.consistency import shortages
from mrbt_mesh.core.planning.demands import request_demands
from mrbt_mesh.core.planning.plan import PendingFailure, Waiting


def pending_failures(
    facts: TeamFacts,
    requests: Sequence[Request],
    waiting: Mapping[int, Waiting],
    obstacles: Collection[int],
    team: Collection[str],
) -> dict[int, PendingFailure]:
    """The requests, by index and in tree order, of which some robot has failed and

    policy `resilient`: no living robots could serve it, whichever are free, not even with what they
    cannot use yet;
    policy `paper`: that too, or failures exceed assigned - nu, where assigned = outcomes + claims
    of the living.

    `waiting`: the requests that are not served; `obstacles`: those that are held whichever robots
    are free.
    """
    tasks = facts.mission.global_tasks
    counted = range(len(requests)) if facts.mission.has_paper_policy else ()
    found = {}
    for index in sorted({*waiting, *counted}):
        activation = requests[index].activation
        task = tasks[requests[index].subject]
        if index in obstacles or not facts.has_outcome(activation):
            continue
        if not _has_failure(facts, task, activation):
            continue
        fails = index in waiting and waiting[index].is_blocked
        if fails and any(facts.members[robot].member.pending for robot in sorted(team)):
            ready = {r: replace(facts.members[r].member, pending={}) for r in sorted(team)}
            fails = not _could_be_served(facts, requests[index], ready)
        if task.failure is FailurePolicy.PAPER:
            fails = fails or _has_failed_by_count(facts, task, activation, team)
        if fails:
            found[index] = PendingFailure(activation, task.failure_after_us)
    return found


def _could_be_served(facts: TeamFacts, request: Request, team: Mapping[str, Member]) -> bool:
    """Whether these robots together could serve a request."""
    workers = {
        robot: Worker(robot, team[robot], facts.members[robot].incarnation)
        for robot in sorted(team)
    }
    capabilities = Capabilities(workers)
    group = request_demands(facts, request, capabilities, {}, is_restricted=False)
    return not shortages(facts, group, capabilities)


def _has_failure(facts: TeamFacts, task: GlobalTask, activation: str) -> bool:
    """Whether some robot has failed there, other than one that merely helped."""
    return any(
        not success
        for need in task.needs
        if need.min_robots
        for success in facts.results(activation, need.local_task).values()
    )


def _has_failed_by_count(
    facts: TeamFacts, task: GlobalTask, activation: str, team: Collection[str]
) -> bool:
    """Whether the failures of some need exceed assigned - nu."""
    for need in task.needs:
        results = facts.results(activation, need.local_task)
        failures = sum(not success for success in results.values())
        claimants = facts.claimants(activation, need.local_task)
        at_it = sum(robot in team and robot not in results for robot in claimants)
        if failures and failures > len(results) + at_it - need.min_robots:
            return True
    return False
