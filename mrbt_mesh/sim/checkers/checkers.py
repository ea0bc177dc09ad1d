"""All checkers of a run, each called with what concerns it."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import CancelAction, Effect, Log, StartAction, Stop
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.sim.checkers.comparison import PlanComparison
from mrbt_mesh.sim.checkers.exclusive import Exclusive
from mrbt_mesh.sim.checkers.facts import Convergence, GarbageChangesNothing, NothingUndone
from mrbt_mesh.sim.checkers.findings import RunFindings, components, joined
from mrbt_mesh.sim.checkers.plans import BidsFirst, OptimalAssignment, SamePlan
from mrbt_mesh.sim.checkers.renewals import Renewals
from mrbt_mesh.sim.checkers.restarts import Resumption
from mrbt_mesh.sim.checkers.work import Progress, WorkWithinBounds
from mrbt_mesh.sim.world.effect_log import EffectLog
from mrbt_mesh.sim.world.faults import Block, Fault, Unblock, fault_text
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.world import World


class Checkers(Inspection):
    """Calls each checker at the moments that could break its invariant, and logs every effect."""

    watches_steps = True

    def __init__(
        self, world: World, comparison: PlanComparison | None = None, keep_log: bool = False
    ) -> None:
        self.world = world
        self.findings = RunFindings(world)
        self.violations = self.findings.violations
        self.checks = self.findings.checks
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
        self._log = EffectLog(keep_log)
        self.effect_log = self._log.lines
        if comparison is not None:
            comparison.findings = self.findings
        self._sampled: list[tuple[str, int, int]] = []
        self._claim: Claim | None = None
        self._running: Claim | None = None
        self._life: Incarnation | None = None

    @property
    def effect_log_digest(self) -> str:
        return self._log.digest

    @property
    def is_settled(self) -> bool:
        return self.i6.is_settled

    @property
    def done_twice(self) -> int:
        return self.i6.done_twice

    @property
    def exclusive_done_twice(self) -> int:
        return self.i5.done_twice

    def lost_journal(self, robot: str) -> None:
        self.i9.lost_journal(robot)

    def booted(self, process: SimProcess) -> None:
        assert process.agent is not None
        self.i9.booted(process, process.agent.view)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        self.i5.synced(process, changes)
        self.i9.synced(process, changes)

    def logged(self, robot: str, effect: Effect) -> None:
        self._log.write(self.world.clock.now_us, robot, effect)

    def published_facts(self) -> None:
        self.findings.changed_us = self.world.clock.now_us

    def fault_comes(self, fault: Fault) -> None:
        self.findings.fault_came(fault.links if isinstance(fault, Block | Unblock) else None)
        self._log.note(self.world.clock.now_us, "-", f'{{"fault":"{fault_text(fault)}"}}')

    def stopped(self) -> None:
        self.findings.fault_came()  # the others have to notice

    def garbage(self, process: SimProcess, event: Input) -> None:
        self.i8.arrives(process, event)

    def never_stopped(self) -> None:
        self.i6.never_stopped()

    def timed_out(self) -> None:
        self.i6.timed_out()

    def handling(self, process: SimProcess, event: Input) -> None:
        assert process.agent is not None
        agent = process.agent.view
        self.i5.handling(process, agent, event)
        self.i6.finishing(agent, event)
        self._claim = agent.claim
        self._running = agent.claim if agent.action is not None else None
        self._life = agent.incarnation

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        assert process.agent is not None
        agent = process.agent.view
        for effect in effects:
            self.logged(process.robot, effect)
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
        """Check what can only be seen of the team as a whole."""
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
        if now_us - max(findings.fault_us, quiet_us) <= repair_us + findings.failure_latch_us:
            return
        agree = self.i2.check_views(agents)
        still_us = now_us - max(findings.changed_us, quiet_us)
        if still_us > repair_us:
            self.i2.at_rest(agents)
            if agree and still_us > repair_us + self.i5.wait_us:
                self.i4.at_rest(agents)
