"""Inputs that wait while a plan is being made elsewhere.

Making a large team's plan may take longer than a robot may be silent, so the runtime does that
(`effects.MakePlan`). It reads the facts, which must not change meanwhile, so any input that could
change them waits. Heartbeats are still sent and received, so nobody considers the robot dead, and
it notices deaths.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.membership.wire import MessageKind

_FACTS = (inputs.MessageReceived, inputs.AnswerReceived)
_ALWAYS = (
    inputs.TokenChanged,
    inputs.RouterAnswered,
    inputs.TimerFired,
    inputs.PositionReported,
    inputs.ProgressReported,
    inputs.TreeTicked,
    inputs.WallClockRead,
    inputs.PlanMade,
    inputs.JournalSynced,
)


class DeferredInputs:
    """The inputs that wait, in order."""

    def __init__(self) -> None:
        self._waiting: deque[inputs.Input] = deque()

    @property
    def waits(self) -> bool:
        """True if inputs wait to be processed as soon as the plan has been made."""
        return bool(self._waiting)

    def due(self, events: Sequence[inputs.Input], busy: bool) -> list[inputs.Input]:
        """Return the inputs to process now that `events` have arrived. `busy`: a plan is being
        made.

        Inputs that waited come before new ones that may change facts, one step at a time: a step is
        one input, or up to `AT_ONCE` consecutive inputs with facts from others.
        """
        found: list[inputs.Input] = []
        for event in events:
            if not _never_waits(event) and (busy or self._waiting):
                self._waiting.append(event)
            else:
                found.append(event)
        is_made = any(isinstance(event, inputs.PlanMade) for event in events)
        if not busy and self._waiting and not is_made:
            first = self._waiting.popleft()
            found.append(first)
            most = inputs.AT_ONCE if isinstance(first, _FACTS) else 1
            while most > 1 and self._waiting and isinstance(self._waiting[0], _FACTS):
                found.append(self._waiting.popleft())
                most -= 1
        return found


def _never_waits(event: inputs.Input) -> bool:
    if isinstance(event, inputs.MessageReceived):
        return event.kind is MessageKind.HEARTBEAT
    return isinstance(event, _ALWAYS)
