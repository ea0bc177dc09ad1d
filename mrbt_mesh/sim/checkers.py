"""What must always hold, checked while a run goes on: the invariants of ARCHITECTURE.md.

I1 same facts and same alive set give the same plan; I2 facts converge; I3 nothing that is done is
undone; I4 nobody works on what it cannot do, and at rest the bounds of every demand hold; I6 what
can be finished is finished; I8 garbage changes nothing. (I5, I7 and I9 are checked elsewhere.)
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Protocol

from mrbt_mesh.core.agent import Agent
from mrbt_mesh.core.assignment import Solver
from mrbt_mesh.core.demand import Consistency, demands_of, workers
from mrbt_mesh.core.effects import Effect, Input, StartAction, TimerFired
from mrbt_mesh.core.evaluate import Request, parse_scope
from mrbt_mesh.core.facts import Incarnation
from mrbt_mesh.core.mission import Mission
from mrbt_mesh.core.plan import Plan, make_plan
from mrbt_mesh.core.records import OrderKind, Outcome, Phase, split_name
from mrbt_mesh.core.team import capability
from mrbt_mesh.core.timing import Timing
from mrbt_mesh.core.tree import Status
from mrbt_mesh.sim.clock import VirtualClock
from mrbt_mesh.sim.network import Link, Network
from mrbt_mesh.sim.process import SimProcess

MAX_VIOLATIONS = 50


class View(Protocol):
    """What the checkers see of a world."""

    @property
    def clock(self) -> VirtualClock: ...
    @property
    def network(self) -> Network: ...
    @property
    def mission(self) -> Mission: ...
    @property
    def timing(self) -> Timing: ...
    @property
    def solver(self) -> Solver: ...
    @property
    def cut_off(self) -> bool: ...
    def living(self) -> list[SimProcess]: ...


class Checkers:
    """Collects violations; `changed_us` is when a fact was last written, `fault_us` when a fault
    last befell.

    `checks` counts how often there was something to check, per invariant: no violation of what
    was never checked means nothing.
    """

    def __init__(self, world: View) -> None:
        self.world = world
        self.changed_us = 0
        self.fault_us = 0
        self.violations: list[str] = []
        self.checks: Counter[str] = Counter()
        self._outcomes: dict[SimProcess, dict[tuple[str, str], bool]] = {}
        self._finished: dict[SimProcess, set[str]] = {}
        self._seen: dict[SimProcess, int] = {}
        self._sampled: list[tuple[str, int, int]] = []

    def handled(self, process: SimProcess, effects: Iterable[Effect]) -> None:
        """After every step of an agent."""
        agent = process.agent
        assert agent is not None
        for effect in effects:
            if isinstance(effect, StartAction):
                self._check_start(agent, effect)
        if self._seen.get(process) != agent.facts.outcome_changes:
            self._seen[process] = agent.facts.outcome_changes
            self._check_done(process, agent)

    def sample(self) -> None:
        """Now and then: what can only be seen of the team as a whole."""
        agents = [p.agent for p in self.world.living() if p.agent and p.agent.joining is None]
        versions = [(a.me, a.facts.changes, a.membership.changes) for a in agents]
        if versions != self._sampled:
            self._sampled = versions
            self._check_same_plan(agents)
        for process in self.world.living():
            if process.agent is not None:
                self._check_done(process, process.agent)
        if not self.world.network.is_reliable_at(self.world.clock.now_us):
            return
        if any(process.is_slow for process in self.world.living()):
            return
        for component in _components(agents, self.world.network.blocked):
            if self._is_quiet(len(agents) - len(component)):
                self._check_converged(component)
                self._check_rest(component)

    def garbage(self, process: SimProcess, event: Input) -> None:
        """I8: let garbage arrive, and see that nothing of it stays."""
        process.deliver(TimerFired())
        self.checks["I8"] += 1
        before = _state(process)
        process.deliver(event)
        after = _state(process)
        if before != after:
            self._say("I8", f"{process.robot} was changed by garbage {event!r:.200}")

    def never_stopped(self) -> None:
        """I6, some time after robots stopped because the mission is over."""
        names = ", ".join(process.robot for process in self.world.living())
        if names:
            self._say("I6", f"the mission is over, but {names} did not stop")

    def timed_out(self) -> None:
        """I6, after a run without a result: the living could not have finished the mission."""
        processes = self.world.living()
        if not processes or self.world.network.blocked:
            return
        agents = [process.agent for process in processes if process.agent is not None]
        if _can_finish(agents[0], {agent.me: agent.incarnation for agent in agents}):
            self._say("I6", "the living robots could finish the mission, but did not in time")

    # -- one robot ----------------------------------------------------------------------------

    def _check_start(self, agent: Agent, start: StartAction) -> None:
        member = agent.facts.members[agent.me][0]
        if capability(member, start.local_task) is None:
            self._say("I4", f"{agent.me} starts {start.local_task}, which it cannot do")
        if agent.facts.task_status(start.global_task, start.activation) is not Status.RUNNING:
            self._say("I3", f"{agent.me} starts {start.activation}, which it knows to be over")
        network, now_us = self.world.network, self.world.clock.now_us
        prompt = network.slowest_us < self.world.timing.grace_us // 4
        if prompt and network.is_reliable_at(now_us) and not self.world.cut_off:
            self._check_crowd(agent, start)

    def _check_crowd(self, agent: Agent, start: StartAction) -> None:
        """I4: where all hear one another in time, mu holds at every moment."""
        place = (start.activation, start.local_task)
        robots = [
            process.robot
            for process in self.world.living()
            if process.agent is not None
            and (action := process.agent.work.action) is not None
            and (action.activation, action.local_task) == place
        ]
        needs = agent.mission.global_tasks[start.global_task].needs
        most = next((n.max_robots for n in needs if n.local_task == start.local_task), 0)
        if len(robots) > most:
            who = ", ".join(robots)
            self._say("I4", f"{who} are on {place[1]} of {place[0]}, at most {most} may be")

    def _check_done(self, process: SimProcess, agent: Agent) -> None:
        facts, evaluator = agent.facts, agent.planner.evaluator
        now: dict[tuple[str, str], bool] = {}
        for entry in facts.map:
            if isinstance(entry.record, Outcome):
                now[entry.author, entry.name] = entry.record.success
        for key, success in self._outcomes.get(process, {}).items():
            activation = split_name(key[1])[1]
            if now.get(key, False) < success and not evaluator.is_obsolete(
                parse_scope(activation), facts
            ):
                self._say("I3", f"{agent.me} has lost {key[1]} of {key[0]}")
        self._outcomes[process] = now
        self.checks["I3"] += len(now)
        finished = self._finished.setdefault(process, set())
        for activation in sorted(finished | facts.begun()):
            scope = parse_scope(activation)
            if facts.task_status(scope.subject, activation) is Status.SUCCESS:
                finished.add(activation)
            elif activation in finished:
                finished.discard(activation)
                if not evaluator.is_obsolete(scope, facts):
                    self._say("I3", f"for {agent.me} {activation} is not finished any more")

    # -- the team -----------------------------------------------------------------------------

    def _plan(self, agent: Agent, alive: Mapping[str, Incarnation]) -> Plan:
        return make_plan(agent.planner.evaluator, agent.facts, alive, self.world.solver)

    def _check_same_plan(self, agents: Iterable[Agent]) -> None:
        groups: dict[tuple[object, ...], list[Agent]] = {}
        for agent in agents:
            key = (agent.facts.map.digest(), tuple(sorted(_alive(agent).items())))
            groups.setdefault(key, []).append(agent)
        for group in groups.values():
            if len(group) > 1:
                self.checks["I1"] += 1
                plans = {self._plan(agent, _alive(agent)).packed for agent in group}
                if len(plans) > 1:
                    names = ", ".join(agent.me for agent in group)
                    self._say("I1", f"{names} have the same facts, but plan differently")

    def _is_quiet(self, strangers: int) -> bool:
        """Whether all repairs must be done: nothing was written or befell for long enough."""
        timing, knobs = self.world.timing, self.world.network.knobs
        # A question may just have been asked in vain; then facts are pulled in at most two steps.
        repair_us = timing.ask_timeout_us + 4 * timing.repair_us + 2 * timing.beat_us
        repair_us += 6 * self.world.network.slowest_us
        verdict_us = 2 * timing.detection_us + (knobs.token_delay_us or 0)
        if strangers or self.world.network.blocked:
            repair_us *= 2  # facts may have to be handed on by a robot in between
        now_us, quiet_us = self.world.clock.now_us, knobs.quiet_from_us or 0
        return (
            now_us - max(self.changed_us, quiet_us) > repair_us
            and now_us - max(self.fault_us, quiet_us) > repair_us + verdict_us
        )

    def _check_converged(self, agents: list[Agent]) -> None:
        self.checks["I2"] += 1
        digests = {agent.facts.map.digest() for agent in agents}
        if len(digests) > 1:
            names = ", ".join(f"{a.me}={a.facts.map.digest().hex()[:8]}" for a in agents)
            self._say("I2", f"facts still differ: {names}")

    def _check_rest(self, agents: list[Agent]) -> None:
        """I4 at rest: everybody does its line of the one plan, and the bounds hold."""
        alive = {agent.me: agent.incarnation for agent in agents}
        if any(_alive(agent) != alive for agent in agents):
            views = "; ".join(f"{a.me}: {' '.join(_alive(a))}" for a in agents)
            self._say("I2", f"views of who is alive still differ from {' '.join(alive)}: {views}")
            return
        self.checks["I4"] += 1
        plan = self._plan(agents[0], alive)
        for agent in agents:
            line, claim = plan.lines.get(agent.me), agent.work.claim
            wanted = (line.activation, line.local_task) if line else None
            runs = claim is not None and claim.phase is Phase.RUNNING
            found = (claim.activation, claim.local_task) if claim and runs else None
            if wanted != found:
                self._say("I4", f"{agent.me} works on {found}, by the plan on {wanted}")
        if plan.order is not OrderKind.RESUME:
            return
        facts = agents[0].facts
        team = workers(facts, alive)
        waiting = {w.activation for w in plan.waiting}
        for group in demands_of(facts, plan.evaluation.requests, team):
            for demand in group:
                place = (demand.request.activation, demand.local_task)
                count = sum((x.activation, x.local_task) == place for x in plan.lines.values())
                low = 0 if place[0] in waiting else demand.lower
                if not low <= count <= demand.upper:
                    bounds = f"{place[0]}: {low}..{demand.upper}"
                    self._say("I4", f"{count} robots on {demand.local_task} of {bounds}")

    def _say(self, invariant: str, text: str) -> None:
        if len(self.violations) < MAX_VIOLATIONS:
            at_s = self.world.clock.now_us / 1e6
            self.violations.append(f"{invariant} at {at_s:.6f} s: {text}")


def _alive(agent: Agent) -> dict[str, Incarnation]:
    return agent.membership.alive() | {agent.me: agent.incarnation}


def _state(process: SimProcess) -> tuple[object, ...]:
    agent = process.agent
    if agent is None:
        return (process.is_over,)
    states = dict(agent.membership.states())
    return (
        process.is_over,
        agent.facts.map.digest(),
        states,
        agent.membership.changes,
        agent.work.claim,
        agent.description.lost,
    )


def _components(agents: list[Agent], blocked: set[Link]) -> list[list[Agent]]:
    """The robots that hear one another both ways, directly or over others."""
    rest, components = list(agents), []
    while rest:
        component = [rest.pop(0)]
        for agent in component:
            near = [
                other
                for other in rest
                if (agent.me, other.me) not in blocked and (other.me, agent.me) not in blocked
            ]
            component += near
            rest = [other for other in rest if other not in near]
        components.append(sorted(component, key=lambda agent: agent.me))
    return components


def _can_finish(agent: Agent, alive: Mapping[str, Incarnation]) -> bool:
    """Whether the living could serve every global task of the tree: more than they may need."""
    mission = agent.mission
    if agent.facts.order() is not OrderKind.RESUME:
        return False
    if agent.plan is not None and any(waiting.obstacle for waiting in agent.plan.waiting):
        return False  # an exclusive task in doubt, or without a majority that lives
    team = workers(agent.facts, alive)
    for node in mission.tree.actions():
        request = Request(node.index, node.subject, "")
        (group,) = demands_of(agent.facts, [request], team)
        if not Consistency(team).keep(0, group, {}):
            return False
    return True
