"""Which inputs an agent may let pass: those from which nothing follows.

An agent settles what follows from its facts, from what it knows of others, and from time. Most
beats change nothing of these; to settle after each would take a robot of a large team most of its
time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.membership.timing import NEVER_US

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.agent import Agent

# What robots and operators ask for always has its answer.
_MAY_PASS = (inputs.MessageReceived, inputs.ProgressReported, inputs.TimerFired)
_NEVER = -1


class DirtyCheck:
    """What an agent knew when it last settled, and until when no more follows from that.

    `step_us` is when time alone asks for more than news of others, questions and beats, each of
    which is due where it is kept.
    """

    def __init__(self, now_us: int) -> None:
        self.step_us = now_us
        self._settled = _NEVER
        # What others report matters only to who waits to start, or to stop.
        self._compares = False

    def begin(self, agent: Agent, now_us: int) -> None:
        """The agent has just settled."""
        self._compares = agent.done_us is not None or agent.work.is_waiting or agent.is_over
        may_pass = (
            agent.joining is None
            and agent.grants.is_idle
            and agent.planner.is_current(agent.membership.changes)
        )
        self._settled = self._changes(agent) if may_pass else _NEVER
        self.step_us = _next_step_us(agent, now_us)

    def lets_pass(self, agent: Agent, event: inputs.Input, now_us: int) -> bool:
        """Whether no more follows from an input than a question or a beat that is due.

        So it is with most.
        """
        return (
            now_us < self.step_us
            and self._settled == self._changes(agent)
            and isinstance(event, _MAY_PASS)
            and agent.membership.is_at_peace(now_us)
        )

    def _changes(self, agent: Agent) -> int:
        """Grows with all that a message can change and that something follows from."""
        membership = agent.membership
        changes = agent.facts.changes + membership.changes + membership.hints
        changes += agent.identity.rivals
        return changes + membership.reports if self._compares else changes


def _next_step_us(agent: Agent, now_us: int) -> int:
    deadlines = [agent.planner.deadlines.next_deadline_us(), agent.grants.next_deadline_us()]
    if agent.joining is not None:
        deadlines.append(agent.joining.deadline_us)
    if agent.work.is_waiting:
        deadlines.append(agent.grace_ends_us())
    if agent.done_us is not None:
        deadlines.append(agent.done_us + agent.config.timing.beat_us)
    earliest_us = NEVER_US
    for deadline_us in deadlines:
        if deadline_us is not None and now_us < deadline_us < earliest_us:
            earliest_us = deadline_us
    return earliest_us
