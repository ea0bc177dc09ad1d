"""All checkers of a run, each called with what concerns it."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import (
    CancelAction,
    Effect,
    Log,
    Publish,
    StartAction,
    Stop,
)
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.sim.checkers.comparison import PlanComparison
from mrbt_mesh.sim.checkers.facts import (
    Delivery,
    NothingUndone,
    garbage_changes_nothing,
    no_difference,
    not_dead_but_heard,
    same_members,
)
from mrbt_mesh.sim.checkers.feature_checker import FeatureCheckers
from mrbt_mesh.sim.checkers.findings import RunFindings, components, joined
from mrbt_mesh.sim.checkers.jobs import KeptJobs
from mrbt_mesh.sim.checkers.plans import optimal_assignment, same_plan
from mrbt_mesh.sim.checkers.progress import Progress
from mrbt_mesh.sim.checkers.renewals import Renewals
from mrbt_mesh.sim.checkers.restarts import Resumption
from mrbt_mesh.sim.checkers.work import (
    able_to_start,
    at_most_mu,
    in_its_place,
    not_taken_off,
    plan_is_carried_out,
    same_arguments,
)
from mrbt_mesh.sim.world.effect_log import EffectLog
from mrbt_mesh.sim.world.faults import Block, Fault, Unblock, fault_text
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import Inspection, SimProcess
from mrbt_mesh.sim.world.world import World


class Checkers(Inspection):
    """Calls each checker at the moments that could break its invariant, and logs every effect."""

    def __init__(
        self, world: World, comparison: PlanComparison | None = None, keep_log: bool = False
    ) -> None:
        super().__init__()
        self.world = world
        self.run = RunFindings(world)
        self.violations, self.checks = self.run.violations, self.run.checks
        self.delivery = Delivery(self.run)
        self.i3 = NothingUndone(self.run)
        self.renewals = Renewals(self.run)
        self.i6 = Progress(self.run)
        self.i9 = Resumption(self.run)
        self.i10 = KeptJobs(self.run)
        self.of_features = FeatureCheckers(self.run)
        self._log = EffectLog(keep_log)
        self.effect_log = self._log.lines
        if comparison is not None:
            comparison.run = self.run
        self._sampled: list[tuple[str, int, int]] = []
        self._turn = 0
        # Before the step: what the agent claimed, whether it was at work on it, in which life.
        self._claim: Claim | None = None
        self._is_running = False
        self._life: Incarnation | None = None

    def lost_journal(self, robot: str) -> None:
        self.i9.lost_journal(robot)
        self.i10.lost_journal(robot)

    def booted(self, process: SimProcess) -> None:
        assert process.agent is not None
        self.i9.booted(process, process.agent.view)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        self.of_features.synced(process, changes)
        self.i9.synced(process, changes)
        self.i10.synced(process, changes)

    def logged(self, robot: str, effect: Effect) -> None:
        self._log.write(self.world.clock.now_us, robot, effect)

    def fault_comes(self, fault: Fault) -> None:
        self.run.fault_came(fault.links if isinstance(fault, Block | Unblock) else None)
        self._log.note(self.world.clock.now_us, "-", f'{{"fault":"{fault_text(fault)}"}}')

    def garbage(self, process: SimProcess, event: Input) -> None:
        garbage_changes_nothing(self.run, process, event)

    def handling(self, process: SimProcess, event: Input) -> None:
        assert process.agent is not None
        agent = process.agent.view
        self.of_features.handling(process, agent, event)
        self.i6.finishing(agent, event)
        self._claim, action = agent.claim, agent.action
        self._is_running = action is not None and not action.travel_to
        self._life = agent.incarnation

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        assert process.agent is not None
        run, agent, before = self.run, process.agent.view, self._claim
        for effect in effects:
            self.logged(process.robot, effect)
            if isinstance(effect, Publish) and effect.kind is MessageKind.FACT:
                run.changed_us = self.world.clock.now_us
            elif isinstance(effect, Stop):
                run.fault_came()  # the others have to notice
        is_fenced = agent.incarnation != self._life
        # What a robot does alone, without contact, is no work of the team.
        effects = [e for e in effects if not isinstance(e, StartAction) or e.global_task]
        for effect in effects:
            if isinstance(effect, CancelAction) and before and self._is_running and not is_fenced:
                not_taken_off(run, agent, before)
            elif isinstance(effect, Log) and effect.event == "robot_dead":
                not_dead_but_heard(run, agent, effect.fields["robot"])
            elif isinstance(effect, Stop):
                self.i3.stopped(agent, effect)
            elif isinstance(effect, StartAction):
                self.i3.started(agent, effect)
                able_to_start(run, agent, effect)
                same_arguments(run, agent, effect)
                if not effect.travel_to:
                    at_most_mu(run, agent, effect)
                    in_its_place(run, agent, effect)
                    self.of_features.started(agent, effect)
        claim = agent.claim
        if claim is not None and (before is None or claim.activation != before.activation):
            self.of_features.claimed(agent, claim)
        if effects:
            self.of_features.handled(process, effects)
            self.i6.handled(agent, effects)
            self.i9.handled(process, event, effects)
            self.i10.handled(process, agent, effects)
        self.i3.check(process, agent)
        self.renewals.check(process, agent)
        self.of_features.stepped(agent)

    def sample(self) -> None:
        """Check what is about the team as a whole."""
        run, agents = self.run, joined(self.world)
        versions = [(a.robot, *a.version) for a in agents]
        if versions != self._sampled:
            self._sampled = versions
            same_plan(run, agents)
            if agents:
                self._turn += 1
                optimal_assignment(run, agents[self._turn % len(agents)])
        for process in self.world.living():
            if process.agent is not None:
                self.i3.check(process, process.agent.view)
        self.delivery.sample(agents)
        self.i6.sample()
        self.i10.sample()
        self.is_settled = self.i6.is_settled
        if run.is_tolerable:
            for component in components(agents, self.world.network.blocked):
                self._check_component(component, len(component) < len(self.world.living()))

    def _check_component(self, agents: list[AgentView], is_part: bool) -> None:
        """Check robots that all hear one another, once enough time has passed."""
        run, network, now_us = self.run, self.world.network, self.world.clock.now_us
        # Facts may have to be handed on by a robot in between.
        repair_us = run.repair_us * (2 if is_part or network.blocked else 1)
        quiet_us = network.knobs.quiet_from_us or 0
        if now_us - max(run.fault_us, quiet_us) <= repair_us + run.agreement_us:
            return
        agree = same_members(run, agents)
        still_us = now_us - max(run.changed_us, quiet_us)
        if still_us > repair_us:
            no_difference(run, agents)
            if agree and still_us > repair_us + self.of_features.wait_us:
                plan_is_carried_out(run, agents)

    def ended(self, outlived: bool, timed_out: bool) -> None:
        if outlived:
            self.i6.never_stopped()
        if timed_out:
            self.i6.timed_out()
        self.done_twice = self.i6.done_twice
        self.exclusive_done_twice = self.of_features.done_twice
        self.effect_log_digest = self._log.digest
