"""Demands: what the requests of T_G ask of the team.

Source: paper, section IV, T_A: the bounds a_j and b_j.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from mrbt_mesh.core.capable import Capable, Worker
from mrbt_mesh.core.coalition import Coalitions, is_in, majority, standing
from mrbt_mesh.core.evaluate import Evaluator, Request
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.mission import GlobalTask, InDoubt, Need
from mrbt_mesh.core.records import Phase, Token
from mrbt_mesh.core.team import TeamFacts
from mrbt_mesh.core.tree import Kind


@dataclass(frozen=True, slots=True)
class Demand:
    """One local task of one request.

    `lower` and `upper` are a_j and b_j, shrunk by the outcomes so far. `pinned` robots are
    already running it (or about to start, with the standing coalition) and count towards both.
    `candidates` map robot to performance for all workers that could be put on it: capable and
    without an outcome for it. `after`: only those that have done something before, and what.
    """

    request: Request
    local_task: str
    needed: int
    lower: int
    upper: int
    pinned: tuple[str, ...]
    candidates: Mapping[str, int]
    after: str = ""


# What one need's demand follows from besides the request: robot -> performance, (robot, success)
# of the outcomes, (since, robot) of the running claims, and who did what has to be done before
# (None: nothing has).
_Inputs: TypeAlias = tuple[
    Mapping[str, int],
    tuple[tuple[str, bool], ...],
    list[tuple[int, str]],
    tuple[str, ...] | None,
]


@dataclass(frozen=True, slots=True)
class _Known:
    request: Request
    inputs: list[_Inputs]
    group: tuple[Demand, ...]

    def holds(self, request: Request, inputs: list[_Inputs]) -> bool:
        same = request is self.request or request == self.request
        return same and all(
            mine[0] is other[0] and mine[1:] == other[1:]
            for mine, other in zip(self.inputs, inputs, strict=True)
        )


class Demands:
    """The demands of the present requests. A group that nothing has changed for stays the same
    object, so that whoever works on demands sees at a glance what is new.
    """

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}
        self._evaluator: Evaluator | None = None

    def groups(
        self, facts: TeamFacts, requests: Sequence[Request], capable: Capable
    ) -> list[tuple[Demand, ...]]:
        """The demands of each request, in tree order and the task's order of needs.

        lower = nu - successes, upper = mu - successes - failures (never below lower). Once
        successes reach nu, nobody new is assigned. At most mu running claims are pinned, in the
        canonical order of claims: (since, robot).
        """
        running: dict[tuple[str, str], list[tuple[int, str]]] = {}
        for robot in capable.team:
            claim = facts.valid_claim(robot)
            if claim is not None and claim.phase is Phase.RUNNING:
                key = (claim.activation, claim.local_task)
                running.setdefault(key, []).append((claim.since, robot))
        before, self._known = self._known, {}
        result = []
        for request in requests:
            task, activation = facts.mission.global_tasks[request.subject], request.activation
            if task.by_coalition:
                did = [self._did(facts, request, need) for need in task.needs]
                result.append(_coalition_demands(facts, request, task, capable, did))
                continue
            inputs: list[_Inputs] = [
                (
                    capable.able(need.local_task),
                    tuple(facts.results(activation, need.local_task).items()),
                    sorted(running.get((activation, need.local_task), ())),
                    self._did(facts, request, need),
                )
                for need in task.needs
            ]
            known = before.get(activation)
            if known is None or not known.holds(request, inputs):
                pairs = zip(task.needs, inputs, strict=True)
                known = _Known(request, inputs, tuple(_demand(request, *pair) for pair in pairs))
            self._known[activation] = known
            result.append(known.group)
        return result

    def _did(self, facts: TeamFacts, request: Request, need: Need) -> tuple[str, ...] | None:
        """Robots with the success that `same_robot_as` asks for; None if the need does not.

        It counts in the present activation of the nearest action before the request, in tree
        order, of which any success is known.
        """
        before = need.same_robot_as
        if before is None:
            return None
        tree = facts.mission.tree
        if self._evaluator is None:
            self._evaluator = Evaluator(tree)
        for node in range(request.node - 1, -1, -1):
            if tree.nodes[node].kind is Kind.ACTION and (
                tree.nodes[node].subject == before.global_task
            ):
                activation = str(self._evaluator.current_scope(node, facts))
                results = facts.results(activation, before.local_task)
                robots = sorted(robot for robot, success in results.items() if success)
                if robots:
                    return tuple(robots)
        return ()


def demands_of(
    facts: TeamFacts, requests: Sequence[Request], capable: Capable
) -> list[tuple[Demand, ...]]:
    """The demands of these requests, for one look."""
    return Demands().groups(facts, requests, capable)


def _demand(request: Request, need: Need, inputs: _Inputs) -> Demand:
    able, results, claims, did = inputs
    if did is not None:
        able = {robot: able[robot] for robot in did if robot in able}
    successes = sum(success for _, success in results)
    lower = max(0, need.min_robots - successes)
    upper = max(lower, need.max_robots - len(results), 0)
    candidates = able
    if results:
        ended = {robot for robot, _ in results}
        candidates = {robot: value for robot, value in able.items() if robot not in ended}
    pinned = tuple(robot for _, robot in claims if robot in candidates)[:upper]
    if not lower:
        upper = len(pinned)
    bounds = need.min_robots, lower, upper
    return Demand(request, need.local_task, *bounds, pinned, candidates, need.after)


def _coalition_demands(
    facts: TeamFacts,
    request: Request,
    task: GlobalTask,
    capable: Capable,
    did: Sequence[tuple[str, ...] | None],
) -> tuple[Demand, ...]:
    """Who has started goes on, and nobody joins; without a coalition the bounds are nu and mu."""
    team, found = capable.team, facts.coalitions(request.activation)
    token = standing(facts, task, request.activation, lives(team))
    at_work = _at_work(facts, request, found, token, team) if token is not None else {}
    result = []
    for need, those in zip(task.needs, did, strict=True):
        failed = found.failed(need.local_task)
        able = capable.able(need.local_task)
        candidates = {
            robot: value
            for robot, value in able.items()
            if robot not in failed and (those is None or robot in those)
        }
        lower, upper = need.min_robots, need.max_robots
        pinned: tuple[str, ...] = ()
        if token is not None:
            pinned = tuple(r for r in candidates if at_work.get(r) == need.local_task)
            lower = upper = len(pinned)
        bounds = need.min_robots, lower, upper
        demand = Demand(request, need.local_task, *bounds, pinned, candidates, need.after)
        result.append(demand)
    return tuple(result)


def _at_work(
    facts: TeamFacts, request: Request, found: Coalitions, token: Token, team: Mapping[str, Worker]
) -> dict[str, str]:
    """Robot -> local task, for the members of a coalition that have not finished."""
    return {
        member.robot: member.local_task
        for member in found.members[token]
        if member.robot in team
        and team[member.robot].incarnation == (member.counter, member.nonce)
        and found.outcome(token, member) is None
        and is_in(facts, token, member, request.activation)
    }


def lives(team: Mapping[str, Worker]) -> dict[str, Incarnation]:
    """Robot -> incarnation."""
    return {robot: worker.incarnation for robot, worker in team.items()}


def obstacle(
    facts: TeamFacts, request: Request, group: Sequence[Demand], team: Mapping[str, Worker]
) -> str:
    """Why an exclusive request cannot be served whoever is free; empty if nothing is in the way."""
    task = facts.mission.global_tasks[request.subject]
    if not task.exclusive:
        return ""
    found = facts.coalitions(request.activation)
    doubted = found.doubted(facts.givers)
    if doubted and task.in_doubt is not InDoubt.RETRY:
        names = ", ".join(sorted({token.leader for token in doubted}))
        return f"in doubt: nobody knows how far {names} got; `mrbt decide` says how it goes on"
    token = standing(facts, task, request.activation, lives(team))
    if token is not None:
        if any(demand.pinned for demand in group):
            return ""
        return f"{token.leader} is out of reach and may still be at it"
    present = sum(robot in facts.givers for robot in team)
    needed = majority(facts.givers)
    if present < needed:
        return (
            f"exclusive: needs grants from {needed} of {len(facts.givers)} robots, {present} here"
        )
    return ""
