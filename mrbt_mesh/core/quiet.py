"""Which inputs an agent may let pass: those from which nothing follows.

An agent settles what follows from its facts, from what it knows of others, and from time. Most
beats change nothing of these; to settle after each would take a robot of a large team most of its
time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mrbt_mesh.core import effects as fx

if TYPE_CHECKING:
    from mrbt_mesh.core.agent import Agent

# What robots and operators ask for always has its answer.
_MAY_PASS = (fx.MessageReceived, fx.ProgressReported, fx.TimerFired)


class Quiet:
    """What an agent knew when it last settled, and until when nothing follows from that."""

    def __init__(self, now_us: int) -> None:
        self._until_us = now_us
        self._settled: tuple[Any, ...] = ()
        # What others report matters only to who waits to start, or to stop.
        self._compares = False

    def begin(self, agent: Agent, now_us: int) -> None:
        """The agent has just settled."""
        self._compares = agent.done_us is not None or agent.work.is_waiting or agent.is_over
        self._settled = self._known(agent)
        self._until_us = now_us

    def lets_pass(self, agent: Agent, event: fx.Input, now_us: int) -> bool:
        """Whether nothing follows from an input but a beat that is due: so it is with most."""
        return (
            now_us < self._until_us
            and isinstance(event, _MAY_PASS)
            and agent.joining is None
            and agent.grants.is_idle
            and self._settled == self._known(agent)
        )

    def _known(self, agent: Agent) -> tuple[Any, ...]:
        """All that another robot's message can change and that something follows from."""
        membership, replica = agent.membership, agent.replica
        return (
            agent.facts.changes,
            membership.changes,
            membership.hints,
            membership.reports if self._compares else -1,
            replica.open_repairs,
            replica.repair_us,
            agent.identity.rival,
        )

    def ends_us(self, agent: Agent, now_us: int) -> int:
        """When, after `now_us`, time alone may ask for more than a beat."""
        if now_us >= self._until_us:
            self._until_us = _next_step_us(agent, now_us)
        return self._until_us


def _next_step_us(agent: Agent, now_us: int) -> int:
    deadlines = [
        agent.membership.next_deadline_us(now_us),
        agent.replica.next_deadline_us(now_us),
        agent.planner.watches.next_deadline_us(),
        agent.grants.next_deadline_us(),
    ]
    if agent.joining is not None:
        deadlines.append(agent.joining.deadline_us)
    if agent.work.is_waiting:
        deadlines.append(agent.grace_ends_us())
    if agent.done_us is not None:
        deadlines.append(agent.done_us + agent.config.timing.beat_us)
    later = [d for d in deadlines if d is not None and d > now_us]
    return min(later, default=now_us + agent.config.timing.detection_us)
