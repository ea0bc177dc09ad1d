"""The parts that features add to an agent, grouped by the methods that they implement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

from mrbt_mesh.core.agent.effects import StartAction
from mrbt_mesh.core.agent.inputs import ActionFinished
from mrbt_mesh.core.agent.start_policy import StartPolicy
from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.feature import Kit, Part, features, overrides
from mrbt_mesh.core.membership.wire import Heartbeat, Request, RequestAnswer
from mrbt_mesh.core.mission.mission import GlobalTask, Mission
from mrbt_mesh.core.planning.plan import Plan


class Parts:
    """The methods of `Part` that the parts in use override, in the order of their features. Methods
    that the mission does not use are never called.
    """

    def __init__(self, kit: Kit) -> None:
        self._kit = kit
        self._of_features: list[Sequence[Part]] = [() for _ in features()]
        self.all: list[Part] = []
        self._note_methods()

    def compose(self, now_us: int) -> None:
        """Create the parts that the mission in force uses, and end those that it no longer uses."""
        known = zip(features(), self._of_features, strict=True)
        self._of_features = [each.parts(self._kit, before, now_us) for each, before in known]
        before, self.all = self.all, list(chain.from_iterable(self._of_features))
        for part in before:
            if all(part is not each for each in self.all):
                part.end(now_us)
        self._note_methods()

    @property
    def is_bound(self) -> bool:
        """True if some part has made, or needs, a promise: see `Part.is_bound`."""
        return True in [is_bound() for is_bound in self._is_bound]

    def request(self) -> Request | None:
        """What this robot's heartbeats request of others."""
        found = (request() for request in self._request)
        return next((each for each in found if each is not None), None)

    def answers(self) -> tuple[RequestAnswer, ...]:
        """The answers to requests of others that its heartbeats carry."""
        return tuple([each for answers in self._answers for each in answers()])

    def start_policy(self, task: GlobalTask) -> StartPolicy | None:
        """The start policy that a part has for this task; None: no part has any."""
        found = (policy(task) for policy in self._start_policy)
        return next((each for each in found if each is not None), None)

    def _note_methods(self) -> None:
        self.heard: list[Callable[[str, Heartbeat, int], None]] = self._own("heard")
        self.finished: list[Callable[[ActionFinished, int], bool]] = self._own("finished")
        self.synced: list[Callable[[], None]] = self._own("synced")
        self._request: list[Callable[[], Request | None]] = self._own("request")
        self._answers: list[Callable[[], Sequence[RequestAnswer]]] = self._own("answers")
        self.resume: list[Callable[[int], None]] = self._own("resume")
        self.first_life: list[Callable[[], None]] = self._own("first_life")
        self._is_bound: list[Callable[[], bool]] = self._own("is_bound")
        self.sent: list[Callable[[int, int], None]] = self._own("sent")
        self.agree: list[Callable[[int], None]] = self._own("agree")
        self.taken_up: list[Callable[[Mission], None]] = self._own("taken_up")
        self.check: list[Callable[[int], bool]] = self._own("check")
        self.follow: list[Callable[[int], None]] = self._own("follow")
        self.may_begin: list[Callable[[Claim, int], bool]] = self._own("may_begin")
        self._start_policy: list[Callable[[GlobalTask], StartPolicy | None]]
        self._start_policy = self._own("start_policy")
        self.started: list[Callable[[StartAction, int], None]] = self._own("started")
        self.settle: list[Callable[[int], None]] = self._own("settle")
        self.prepare: list[Callable[[Plan, int], None]] = self._own("prepare")
        self.perform: list[Callable[[Plan, int], None]] = self._own("perform")
        self.next_us: list[Callable[[int], int | None]] = self._own("next_us")
        self.steps_until_us: list[Callable[[], int | None]] = self._own("steps_until_us")

    def _own(self, name: str) -> list[Any]:
        return [getattr(part, name) for part in self.all if overrides(part, Part, name)]
