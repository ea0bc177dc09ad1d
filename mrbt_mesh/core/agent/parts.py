"""The parts that features add to an agent, grouped by the methods that they implement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

from mrbt_mesh.core.facts.records import Claim
from mrbt_mesh.core.feature import Kit, Part, features
from mrbt_mesh.core.membership.wire import Heartbeat
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

    def _note_methods(self) -> None:
        self.heard: list[Callable[[str, Heartbeat], None]] = self._own("heard")
        self.sent: list[Callable[[int, int], None]] = self._own("sent")
        self.check: list[Callable[[int], bool]] = self._own("check")
        self.follow: list[Callable[[int], None]] = self._own("follow")
        self.may_begin: list[Callable[[Claim, bool, int], bool]] = self._own("may_begin")
        self.prepare: list[Callable[[Plan, int], None]] = self._own("prepare")
        self.perform: list[Callable[[Plan, int], None]] = self._own("perform")
        self.next_us: list[Callable[[int], int | None]] = self._own("next_us")
        self.steps_until_us: list[Callable[[], int | None]] = self._own("steps_until_us")

    def _own(self, name: str) -> list[Any]:
        return [
            getattr(part, name)
            for part in self.all
            if getattr(type(part), name) is not getattr(Part, name)
        ]
