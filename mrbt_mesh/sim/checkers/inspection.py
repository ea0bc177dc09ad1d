"""Looks on in a run: checks every invariant, and logs every effect."""

from __future__ import annotations

from collections.abc import Sequence

from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.sim.checkers.checkers import Checkers
from mrbt_mesh.sim.checkers.comparison import PlanComparison
from mrbt_mesh.sim.checkers.findings import View
from mrbt_mesh.sim.world.effect_log import EffectLog
from mrbt_mesh.sim.world.faults import Block, Fault, Unblock, fault_text
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import Inspection, SimProcess


class FullInspection(Inspection):
    """Checks every invariant and logs every effect."""

    watches_steps = True

    def __init__(self, world: View, comparison: PlanComparison, keep_log: bool) -> None:
        self._world = world
        self._checkers = Checkers(world)
        comparison.findings = self._checkers.findings
        self._log = EffectLog(keep_log)
        self.violations = self._checkers.violations
        self.checks = self._checkers.checks
        self.effect_log = self._log.lines

    @property
    def effect_log_digest(self) -> str:
        return self._log.digest

    @property
    def is_settled(self) -> bool:
        return self._checkers.i6.is_settled

    @property
    def done_twice(self) -> int:
        return self._checkers.i6.done_twice

    @property
    def exclusive_done_twice(self) -> int:
        return self._checkers.i5.done_twice

    def lost_journal(self, robot: str) -> None:
        self._checkers.i9.lost_journal(robot)

    def booted(self, process: SimProcess) -> None:
        self._checkers.booted(process)

    def synced(self, process: SimProcess, changes: Changes) -> None:
        self._checkers.i5.synced(process, changes)
        self._checkers.i9.synced(process, changes)

    def handling(self, process: SimProcess, event: Input) -> None:
        self._checkers.handling(process, event)

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        for effect in effects:
            self.logged(process.robot, effect)
        self._checkers.handled(process, event, effects)

    def logged(self, robot: str, effect: Effect) -> None:
        self._log.write(self._world.clock.now_us, robot, effect)

    def published_facts(self) -> None:
        self._checkers.findings.changed_us = self._world.clock.now_us

    def fault_comes(self, fault: Fault) -> None:
        links = fault.links if isinstance(fault, Block | Unblock) else None
        self._checkers.findings.fault_came(links)
        self._log.note(self._world.clock.now_us, "-", f'{{"fault":"{fault_text(fault)}"}}')

    def stopped(self) -> None:
        self._checkers.findings.fault_came()  # the others have to notice

    def garbage(self, process: SimProcess, event: Input) -> None:
        self._checkers.i8.arrives(process, event)

    def sample(self) -> None:
        self._checkers.sample()

    def never_stopped(self) -> None:
        self._checkers.i6.never_stopped()

    def timed_out(self) -> None:
        self._checkers.i6.timed_out()
