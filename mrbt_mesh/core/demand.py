"""Demands: what the requests of T_G ask of the team.

Source: paper, section IV, T_A: the bounds a_j and b_j.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Any

from mrbt_mesh.core.capable import Capable, Worker
from mrbt_mesh.core.coalition import Coalitions, is_in, majority, standing
from mrbt_mesh.core.evaluate import Evaluator, Request
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.mission import GlobalTask, InDoubt, Need
from mrbt_mesh.core.records import Claim, Phase, Token
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


_NONE: Mapping[str, Any] = {}


class _Running:
    """Who runs what, of a team."""

    def __init__(self) -> None:
        # Activation -> local task -> robots, in the canonical order of claims: (since, robot).
        # What has not changed is the same object.
        self.at: dict[str, Mapping[str, tuple[str, ...]]] = {}
        self._seen: dict[str, Any] = {}
        self._claims: dict[str, Claim] = {}
        self._robots: dict[str, dict[str, None]] = {}

    def follow(self, facts: TeamFacts, team: Mapping[str, Worker]) -> None:
        """The claims as they are now."""
        claims = map(facts.claims.get, team)
        before = self._seen
        self._seen = seen = dict(zip(team, zip(team.values(), claims, strict=True), strict=True))
        others = [robot for robot, each in seen.items() if before.get(robot) != each]
        others += [robot for robot in before if robot not in seen]
        changed: dict[str, None] = {}
        for robot in others:
            old = self._claims.pop(robot, None)
            if old is not None:
                del self._robots[old.activation][robot]
                changed[old.activation] = None
            new = facts.valid_claim(robot) if robot in team else None
            if new is not None and new.phase is Phase.RUNNING:
                self._claims[robot] = new
                self._robots.setdefault(new.activation, {})[robot] = None
                changed[new.activation] = None
        for activation in changed:
            self._tell(activation)

    def _tell(self, activation: str) -> None:
        robots = self._robots[activation]
        if not robots:
            del self._robots[activation]
            self.at.pop(activation, None)
            return
        found: dict[str, tuple[str, ...]] = {}
        for robot in sorted(robots, key=lambda robot: (self._claims[robot].since, robot)):
            local_task = self._claims[robot].local_task
            found[local_task] = (*found.get(local_task, ()), robot)
        if found != self.at.get(activation):
            self.at[activation] = found


@dataclass(frozen=True, slots=True)
class _Known:
    """An activation's demands and what they follow from: for each need who can do it, and who did
    what has to be done before (None: nothing has); the outcomes and running robots by local task.
    """

    able: list[Mapping[str, int]]
    did: list[tuple[str, ...] | None]
    ends: Mapping[str, Mapping[str, bool]]
    running: Mapping[str, tuple[str, ...]]
    group: tuple[Demand, ...]


class Demands:
    """The demands of the present requests. A group that nothing has changed for stays the same
    object, so that whoever works on demands sees at a glance what is new.
    """

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}
        self._running = _Running()
        self._evaluator: Evaluator | None = None

    def groups(
        self, facts: TeamFacts, requests: Sequence[Request], capable: Capable
    ) -> list[tuple[Demand, ...]]:
        """The demands of each request, in tree order and the task's order of needs.

        lower = nu - successes, upper = mu - successes - failures (never below lower). Once
        successes reach nu, nobody new is assigned. At most mu running claims are pinned, in the
        canonical order of claims: (since, robot).
        """
        self._running.follow(facts, capable.team)
        tasks, outcomes, running = facts.mission.global_tasks, facts.outcomes, self._running.at
        before, self._known = self._known, {}
        result = []
        for request in requests:
            task, activation = tasks[request.subject], request.activation
            if task.by_coalition:
                did = [self._did(facts, request, need) for need in task.needs]
                result.append(_coalition_demands(facts, request, task, capable, did))
                continue
            known = before.get(activation)
            able = [capable.able(need.local_task) for need in task.needs]
            did = [
                None if need.same_robot_as is None else self._did(facts, request, need)
                for need in task.needs
            ]
            ends, runs = outcomes.get(activation, _NONE), running.get(activation, _NONE)
            if (
                known is None
                or known.ends is not ends
                or known.running is not runs
                or not all(map(is_, known.able, able))
                or known.did != did
            ):
                group = tuple(
                    _demand(request, *each, ends, runs)
                    for each in zip(task.needs, able, did, strict=True)
                )
                known = _Known(able, did, ends, runs, group)
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


def _demand(
    request: Request,
    need: Need,
    able: Mapping[str, int],
    did: tuple[str, ...] | None,
    ends: Mapping[str, Mapping[str, bool]],
    running: Mapping[str, tuple[str, ...]],
) -> Demand:
    results = ends.get(need.local_task, {})
    if did is not None:
        able = {robot: able[robot] for robot in did if robot in able}
    successes = sum(results.values())
    lower = max(0, need.min_robots - successes)
    upper = max(lower, need.max_robots - len(results), 0)
    candidates = able
    if results:
        candidates = {robot: value for robot, value in able.items() if robot not in results}
    runners = running.get(need.local_task, ())
    pinned = tuple(robot for robot in runners if robot in candidates)[:upper]
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
