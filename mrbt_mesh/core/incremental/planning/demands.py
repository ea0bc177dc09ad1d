"""What requests ask of the team, brought up to date."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Any

from mrbt_mesh.core.bt.activation import ActivationNames
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.capabilities import Capabilities, Worker
from mrbt_mesh.core.planning.demands import Group, allowed_robots, request_demands

_NONE: Mapping[str, Any] = {}


class _RunningClaims:
    """`running_claims`, brought up to date."""

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
    """The demands of an activation, and what they follow from."""

    able: list[Mapping[str, int]]
    allowed: tuple[tuple[str, ...] | None, ...]
    ends: Mapping[str, Mapping[str, bool]]
    running: Mapping[str, tuple[str, ...]]
    group: Group


class FollowedDemands:
    """The demands of the present requests. A group that nothing has changed for stays the same
    object, so that whoever works on demands sees at a glance what is new.
    """

    def __init__(self, names: ActivationNames) -> None:
        self._names = names
        self._known: dict[str, _Known] = {}
        self._running = _RunningClaims()

    def follow(
        self, facts: TeamFacts, requests: Sequence[Request], capabilities: Capabilities
    ) -> list[Group]:
        """`demands_of` these requests."""
        self._running.follow(facts, capabilities.team)
        tasks, running = facts.mission.global_tasks, self._running.at
        before, self._known = self._known, {}
        result = []
        for request in requests:
            task, activation = tasks[request.subject], request.activation
            allowed = allowed_robots(facts, request, self._names)
            runs = running.get(activation, _NONE)
            if task.by_coalition:
                result.append(request_demands(facts, request, capabilities, allowed, runs))
                continue
            known = before.get(activation)
            able = [capabilities.able(need.local_task) for need in task.needs]
            ends = facts.outcomes(activation)
            if (
                known is None
                or known.ends is not ends
                or known.running is not runs
                or not all(map(is_, known.able, able))
                or known.allowed != allowed
            ):
                group = request_demands(facts, request, capabilities, allowed, runs)
                known = _Known(able, allowed, ends, runs, group)
            self._known[activation] = known
            result.append(known.group)
        return result
