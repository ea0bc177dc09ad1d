"""The state that all checkers share: violations found, and how long things may take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.mission.mission import majority
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.sim.world.network import Link
from mrbt_mesh.sim.world.world import World

MAX_VIOLATIONS = 50


class RunFindings:
    """The violations of a run, and the times that checkers wait for.

    `changed_us`: the last write of a fact; `fault_us`: the last fault; `cut_us`: by link, when it
    was last cut or came back; `other_us`: the last fault of another kind. `checks` counts the
    checks per invariant: without checks, no violations mean nothing.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.changed_us = 0
        self.fault_us = 0
        self.other_us = 0
        self.cut_us: dict[Link, int] = {}
        self.violations: list[str] = []
        self.checks: Counter[str] = Counter()

    def fault_came(self, links: Iterable[Link] | None = None) -> None:
        """Note a fault: of these links, or (None) of another kind."""
        self.fault_us = now_us = self.world.clock.now_us
        if links is None:
            self.other_us = now_us
        else:
            self.cut_us.update(dict.fromkeys(links, now_us))

    def violation(self, invariant: str, text: str) -> None:
        """Note a violation."""
        if len(self.violations) < MAX_VIOLATIONS:
            at_s = self.world.clock.now_us / 1e6
            self.violations.append(f"{invariant} at {at_s:.6f} s: {text}")

    @property
    def repair_us(self) -> int:
        """How long facts may take to reach everybody, when no message is lost."""
        timing = self.world.timing
        # A question may just have failed; then facts are pulled in at most two steps.
        repair_us = timing.ask_timeout_us + 4 * timing.repair_us + 2 * timing.heartbeat_us
        return repair_us + 6 * (self.world.network.slowest_us + self.world.plan_delay_us)

    @property
    def agreement_us(self) -> int:
        """How long it may take until all have the same members, and newcomers have joined."""
        knobs = self.world.network.knobs
        return self.world.timing.max_detection_us + (knobs.token_delay_us or 0)

    @property
    def settling_us(self) -> int:
        """How long it may take until all have the same facts and the same members."""
        return self.repair_us + self.agreement_us

    @property
    def may_lack_grants(self) -> bool:
        """Whether a living robot does not hear a majority, itself included, both ways.

        Grants travel with heartbeats, which nobody relays.
        """
        blocked, grantors = self.world.network.blocked, self.world.mission.robot_ids
        living = [process.robot for process in self.world.living() if process.robot in grantors]
        return bool(blocked) and any(
            sum((a, b) not in blocked and (b, a) not in blocked for b in living)
            < majority(grantors)
            for a in living
        )

    @property
    def is_tolerable(self) -> bool:
        """Whether no message is lost and no robot is slow now, so that liveness is required."""
        world = self.world
        reliable = world.network.is_reliable_at(world.clock.now_us)
        return reliable and not any(process.is_slow for process in world.living())


def current_plan(agent: AgentView, solver: Solver) -> Plan:
    """The plan that follows from the agent's facts and alive set as they are now."""
    if agent.plan is not None and agent.is_plan_current:
        return agent.plan
    return make_plan(agent.facts, agent.alive(), solver)


def joined(world: World) -> list[AgentView]:
    """The agents of living processes that have taken their place in the team."""
    return [
        p.agent.view for p in world.living() if p.agent is not None and not p.agent.view.is_joining
    ]


def is_connected(agents: list[AgentView], blocked: set[Link]) -> bool:
    """Whether all hear one another both ways, directly or through others."""
    return not blocked or len(components(agents, blocked)) == 1


def components(agents: list[AgentView], blocked: set[Link]) -> list[list[AgentView]]:
    """The groups of robots that hear one another both ways, directly or through others.

    A group that has a one-way link to or from another one is left out.
    """
    rest, found = list(agents), []
    while rest:
        component = [rest.pop(0)]
        for agent in component:
            near = [
                other
                for other in rest
                if (agent.robot, other.robot) not in blocked
                and (other.robot, agent.robot) not in blocked
            ]
            component += near
            rest = [other for other in rest if other not in near]
        found.append(sorted(component, key=lambda agent: agent.robot))
    return [component for component in found if not _leaks(component, agents, blocked)]


def _leaks(component: list[AgentView], agents: list[AgentView], blocked: set[Link]) -> bool:
    inside = {agent.robot for agent in component}
    outside = {agent.robot for agent in agents} - inside
    return not all((a, b) in blocked and (b, a) in blocked for a in inside for b in outside)
