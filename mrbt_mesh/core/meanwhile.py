"""What an agent does while a plan is being made elsewhere.

A large team's plan may take longer than a robot may be silent. Its making is then left to the
runtime (`effects.MakePlan`). Until it is made the facts must stay as they are, since it reads
them: what could change them waits. Beats go out and are heard, so that nobody takes the robot for
dead, and nobody's death goes unnoticed.
"""

from __future__ import annotations

from collections import deque

from mrbt_mesh.core import effects as fx
from mrbt_mesh.core.wire import MessageKind

# They may be taken in together before the next plan.
_FACTS = (fx.MessageReceived, fx.AnswerReceived)
_ALWAYS = (
    fx.MessageReceived,
    fx.TokenChanged,
    fx.TimerFired,
    fx.ProgressReported,
    fx.PlanMade,
)


class Meanwhile:
    """The inputs that wait, in order."""

    def __init__(self) -> None:
        self._waiting: deque[fx.Input] = deque()

    @property
    def waits(self) -> bool:
        """Whether anything is to be taken in as soon as the plan has been made."""
        return bool(self._waiting)

    def due(self, event: fx.Input, busy: bool) -> list[fx.Input]:
        """What is to be taken in now that `event` has come, while a plan is made or not.

        What has waited comes before what may change facts, one step at a time: one input, or
        all facts from others that come first.
        """
        if isinstance(event, _ALWAYS) and not _changes_facts(event):
            found: list[fx.Input] = [event]
        elif busy or self._waiting:
            self._waiting.append(event)
            found = []
        else:
            return [event]
        if not busy and self._waiting and not isinstance(event, fx.PlanMade):
            found.append(self._waiting.popleft())
            while isinstance(found[-1], _FACTS) and self._waiting:
                if not isinstance(self._waiting[0], _FACTS):
                    break
                found.append(self._waiting.popleft())
        return found


def _changes_facts(event: fx.Input) -> bool:
    return isinstance(event, fx.MessageReceived) and event.kind is not MessageKind.BEAT
