"""Which inputs need no answer but a question or a beat that is due: a dirty check.

An agent follows up what follows from its facts, from what it knows of others, and from time. Most
beats change nothing of these; to follow up after each would take a robot of a large team most of
its time.
"""

from __future__ import annotations

from mrbt_mesh.core.agent.context import Context
from mrbt_mesh.core.agent.inputs import Input, MessageReceived, ProgressReported, TimerFired
from mrbt_mesh.core.membership.duplicate_ids import DuplicateIdCheck

# What robots and operators ask for always has its answer.
_MAY_PASS = (MessageReceived, ProgressReported, TimerFired)
_DIRTY = -1


class DirtyCheck:
    """What an agent knew when it last followed up, and until when nothing more follows from that.

    `step_us` is when time alone asks for more than news of others, questions and beats, each of
    which is due where it is kept.
    """

    def __init__(self, context: Context, duplicates: DuplicateIdCheck, now_us: int) -> None:
        self.step_us = now_us
        self._context = context
        self._duplicates = duplicates
        self._seen = _DIRTY
        self._reads_reports = False

    def clean(self, reads_reports: bool, step_us: int) -> None:
        """Everything has been followed up.

        `reads_reports`: what others report matters, to who waits to start or to stop.
        """
        self._reads_reports = reads_reports
        self._seen = self._changes()
        self.step_us = step_us

    def spoil(self, step_us: int) -> None:
        """The next input has to be followed up, whatever it is."""
        self._seen = _DIRTY
        self.step_us = step_us

    def is_clean(self, event: Input, now_us: int) -> bool:
        """Whether nothing follows from an input. So it is with most."""
        return (
            now_us < self.step_us
            and self._seen == self._changes()
            and isinstance(event, _MAY_PASS)
            and self._context.membership.is_at_peace(now_us)
        )

    def _changes(self) -> int:
        """Grows with all that a message can change and that something follows from."""
        membership = self._context.membership
        changes = (
            self._context.facts.changes + membership.alive_changes + membership.suspicion_changes
        )
        changes += self._duplicates.changes
        return changes + membership.report_changes if self._reads_reports else changes
