"""When a robot's facts show a fact that follows from others.

See `facts.derived` and `membership.unproved`. This is the definition by which robots, and those who
check their recordings, decide.
"""

from __future__ import annotations

from collections.abc import Mapping

from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.derived import is_known
from mrbt_mesh.core.facts.records import MissionResult
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts


class DerivedFacts:
    """What these facts show. That a time is over is not among it: each robot measures that itself.

    `alive`: the robots that one counts on.
    """

    def __init__(
        self, facts: TeamFacts, evaluation: Evaluation, alive: Mapping[str, Incarnation]
    ) -> None:
        self._facts = facts
        self._evaluation = evaluation
        self._alive = alive

    def show(self, entry: Entry) -> bool:
        """True if this entry follows from the facts, or they say the same already."""
        return is_known(self._facts, entry) or self._follows(entry)

    def _follows(self, entry: Entry) -> bool:
        evaluation = self._evaluation
        if isinstance(entry.record, MissionResult):
            ended = Status.SUCCESS if entry.record.success else Status.FAILURE
            return evaluation.status is ended
        if (index := self._facts.index_of(entry)) is not None:
            return index.shows(entry, self._alive)
        is_failure = entry.parts[0] == records.LATCHED_FAILURE
        return is_failure and entry.parts[1] in evaluation.failures
