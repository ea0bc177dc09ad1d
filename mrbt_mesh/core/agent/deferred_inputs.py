"""What an agent does while a plan is being made elsewhere.

A large team's plan may take longer than a robot may be silent. Its making is then left to the
runtime (`effects.MakePlan`). Until it is made the facts must stay as they are, since it reads
them: what could change them waits. Beats go out and are heard, so that nobody takes the robot for
dead, and nobody's death goes unnoticed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.membership.wire import MessageKind

_FACTS = (inputs.MessageReceived, inputs.AnswerReceived)
_ALWAYS = (
    inputs.MessageReceived,
    inputs.TokenChanged,
    inputs.RouterAnswered,
    inputs.TimerFired,
    inputs.PositionReported,
    inputs.ProgressReported,
    inputs.TreeTicked,
    inputs.PlanMade,
    inputs.JournalSynced,
)


class DeferredInputs:
    """The inputs that wait, in order."""

    def __init__(self) -> None:
        self._waiting: deque[inputs.Input] = deque()

    @property
    def waits(self) -> bool:
        """Whether anything is to be taken in as soon as the plan has been made."""
        return bool(self._waiting)

    def due(self, events: Sequence[inputs.Input], busy: bool) -> list[inputs.Input]:
        """What is to be taken in now that `events` have come, while a plan is made or not.

        What has waited comes before what may change facts, one step at a time: one input, or
        the facts from others that come first.
        """
        found: list[inputs.Input] = []
        for event in events:
            if isinstance(event, _ALWAYS) and not _changes_facts(event):
                found.append(event)
            elif busy or self._waiting:
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


def _changes_facts(event: inputs.Input) -> bool:
    return isinstance(event, inputs.MessageReceived) and event.kind is not MessageKind.HEARTBEAT
