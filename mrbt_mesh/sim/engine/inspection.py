"""Who watches a run: nobody, for statistics, or the checkers and the effect log.

Watching changes nothing of what happens.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.sim.checkers import Checkers, View
from mrbt_mesh.sim.engine.effect_log import EffectLog
from mrbt_mesh.sim.engine.faults import Block, Fault, Unblock
from mrbt_mesh.sim.engine.injector import fault_text
from mrbt_mesh.sim.engine.process import SimProcess


class Inspection:
    """The moments of a run at which somebody may look; this one looks at nothing.

    `violations` are the invariants that did not hold, `checks` how often each one was checked.
    `watches_steps`: whether `handling` and `handled` are called, for each step of each agent.
    `is_settled`: nothing more will come of the run. `done_twice` counts local tasks that
    succeeded more often than their `max`, `exclusive_done_twice` exclusive tasks that did.
    """

    violations: Sequence[str] = ()
    checks: Mapping[str, int] = {}
    effect_log: Sequence[str] = ()
    watches_steps = False

    @property
    def effect_log_digest(self) -> str:
        return ""

    @property
    def is_settled(self) -> bool:
        return False

    @property
    def done_twice(self) -> int:
        return 0

    @property
    def exclusive_done_twice(self) -> int:
        return 0

    def lost_journal(self, robot: str) -> None:
        """A robot is launched with an empty journal."""

    def booted(self, process: SimProcess) -> None:
        """A process has read its journal and has an agent."""

    def handling(self, process: SimProcess, event: Input) -> None:
        """Before a step of an agent."""

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        """After a step of an agent; its effects have been carried out."""

    def logged(self, robot: str, effect: Effect) -> None:
        """A robot's program, or what runs it, had something to say."""

    def published_facts(self) -> None:
        """Somebody has told the team something new."""

    def befalls(self, fault: Fault) -> None:
        """A fault is about to happen."""

    def stopped(self) -> None:
        """A robot has stopped by itself."""

    def garbage(self, process: SimProcess, event: Input) -> None:
        """Something malformed, foreign or forged arrives."""
        process.deliver(event)

    def sample(self) -> None:
        """Called once per beat period."""

    def never_stopped(self) -> None:
        """Some time after robots stopped because the mission is over, others still run."""

    def timed_out(self) -> None:
        """The run has ended without a result."""


class FullInspection(Inspection):
    """Checks every invariant and logs every effect."""

    watches_steps = True

    def __init__(self, world: View, keep_log: bool) -> None:
        self._world = world
        self._checkers = Checkers(world)
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

    def befalls(self, fault: Fault) -> None:
        links = fault.links if isinstance(fault, Block | Unblock) else None
        self._checkers.findings.befell(links)
        self._log.note(self._world.clock.now_us, "-", f'{{"fault":"{fault_text(fault)}"}}')

    def stopped(self) -> None:
        self._checkers.findings.befell()  # the others have to notice

    def garbage(self, process: SimProcess, event: Input) -> None:
        self._checkers.i8.arrives(process, event)

    def sample(self) -> None:
        self._checkers.sample()

    def never_stopped(self) -> None:
        self._checkers.i6.never_stopped()

    def timed_out(self) -> None:
        self._checkers.i6.timed_out()
