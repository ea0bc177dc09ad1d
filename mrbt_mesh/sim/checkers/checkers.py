"""All checkers of a run, each told what concerns it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import CancelAction, Effect, Log, StartAction, Stop
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.sim.checkers.exclusive import Exclusive
from mrbt_mesh.sim.checkers.facts import Convergence, GarbageChangesNothing, NothingUndone
from mrbt_mesh.sim.checkers.findings import RunFindings, View, components, joined
from mrbt_mesh.sim.checkers.plans import BidsFirst, OptimalAssignment, SamePlan
from mrbt_mesh.sim.checkers.renewals import Renewals
from mrbt_mesh.sim.checkers.restarts import Resumption
from mrbt_mesh.sim.checkers.work import Progress, WorkWithinBounds
from mrbt_mesh.sim.world.process import SimProcess


class Checkers:
    """Tells each checker what happens, at the moments that could break its invariant."""

    def __init__(self, world: View) -> None:
        self.world = world
        self.findings = RunFindings(world)
        self.i1 = SamePlan(self.findings)
        self.i2 = Convergence(self.findings)
        self.i3 = NothingUndone(self.findings)
        self.renewals = Renewals(self.findings)
        self.i4 = WorkWithinBounds(self.findings)
        self.i5 = Exclusive(self.findings)
        self.i6 = Progress(self.findings)
        self.i7 = OptimalAssignment(self.findings)
        self.bids = BidsFirst(self.findings)
        self.i8 = GarbageChangesNothing(self.findings)
        self.i9 = Resumption(self.findings)
        self._sampled: list[tuple[str, int, int]] = []
        self._claim: Claim | None = None
        self._running: Claim | None = None
        self._life: Incarnation | None = None

    @property
    def violations(self) -> list[str]:
        return self.findings.violations

    @property
    def checks(self) -> Counter[str]:
        return self.findings.checks

    def booted(self, process: SimProcess) -> None:
        """A process has read its journal and has an agent."""
        assert process.agent is not None
        self.i9.booted(process, process.agent.view)

    def handling(self, process: SimProcess, event: Input) -> None:
        """Before a step of an agent."""
        agent = process.agent.view if process.agent is not None else None
        assert agent is not None
        self.i5.handling(process, agent, event)
        self.i6.finishing(agent, event)
        self._claim = agent.claim
        self._running = agent.claim if agent.action is not None else None
        self._life = agent.incarnation

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        """After every step of an agent."""
        agent = process.agent.view if process.agent is not None else None
        assert agent is not None
        for effect in effects:
            fenced = agent.incarnation != self._life
            if isinstance(effect, CancelAction) and self._running is not None and not fenced:
                self.i4.cancelled(agent, self._running)
            elif isinstance(effect, Log) and effect.event == "robot_dead":
                self.i2.declared_dead(agent, effect.fields["robot"])
            elif isinstance(effect, Stop):
                self.i3.stopped(agent, effect)
            elif isinstance(effect, StartAction):
                self.i3.started(agent, effect)
                self.i4.started(agent, effect)
        claim = agent.claim
        if claim is not None and (
            self._claim is None or claim.activation != self._claim.activation
        ):
            self.bids.claimed(agent, claim)
        if effects:
            self.i5.handled(process, effects)
            self.i6.handled(process, event, effects)
            self.i9.handled(process, event, effects)
        self.i3.check(process, agent)
        self.renewals.check(process, agent)

    def sample(self) -> None:
        """Now and then: what can only be seen of the team as a whole."""
        agents = joined(self.world)
        versions = [(a.robot, *a.version) for a in agents]
        if versions != self._sampled:
            self._sampled = versions
            self.i1.sample(agents)
            self.i7.sample(agents)
        for process in self.world.living():
            if process.agent is not None:
                self.i3.check(process, process.agent.view)
        self.i2.sample(agents)
        self.i6.sample()
        if self.findings.is_tolerable:
            for component in components(agents, self.world.network.blocked):
                self._check_component(component, len(component) < len(self.world.living()))

    def _check_component(self, agents: list[AgentView], is_part: bool) -> None:
        """What must hold where all hear one another, once enough time has passed."""
        findings, network, now_us = self.findings, self.world.network, self.world.clock.now_us
        # Facts may have to be handed on by a robot in between.
        repair_us = findings.repair_us * (2 if is_part or network.blocked else 1)
        quiet_us = network.knobs.quiet_from_us or 0
        if now_us - max(findings.fault_us, quiet_us) <= repair_us + findings.verdict_us:
            return
        agree = self.i2.check_views(agents)
        still_us = now_us - max(findings.changed_us, quiet_us)
        if still_us > repair_us:
            self.i2.at_rest(agents)
            if agree and still_us > repair_us + self.i5.wait_us:
                self.i4.at_rest(agents)
