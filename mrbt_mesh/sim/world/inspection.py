"""Who looks on in a run: nobody, for statistics, or whoever overrides what is called here.

Looking on changes nothing of what happens.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mrbt_mesh.core.agent.effects import Effect
from mrbt_mesh.core.agent.inputs import Input
from mrbt_mesh.sim.world.faults import Fault
from mrbt_mesh.sim.world.journal import Changes
from mrbt_mesh.sim.world.process import SimProcess


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

    def synced(self, process: SimProcess, changes: Changes) -> None:
        """A process has put this on its disk."""

    def handling(self, process: SimProcess, event: Input) -> None:
        """Before a step of an agent."""

    def handled(self, process: SimProcess, event: Input, effects: Sequence[Effect]) -> None:
        """After a step of an agent; its effects have been carried out."""

    def logged(self, robot: str, effect: Effect) -> None:
        """A robot's program, or what runs it, had something to say."""

    def published_facts(self) -> None:
        """Somebody has told the team something new."""

    def fault_comes(self, fault: Fault) -> None:
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
