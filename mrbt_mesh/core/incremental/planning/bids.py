"""What bids make of the demands, brought up to date."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mrbt_mesh.core.facts.activation_facts import KnownBids
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.bids import Bids, GroupBids, begun_activations, is_begun, with_bids
from mrbt_mesh.core.planning.capabilities import Worker
from mrbt_mesh.core.planning.demands import Group


@dataclass(frozen=True, slots=True)
class _Known:
    """What the bids make of one request's demands, and from what that follows."""

    declared: Group
    said: KnownBids
    has_begun: bool
    bids: GroupBids


class FollowedBids:
    """The bids for the present requests. What nothing has changed for stays the same object."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}

    def follow(self, facts: TeamFacts, groups: Sequence[Group], team: Mapping[str, Worker]) -> Bids:
        """`bids_for` these demands."""
        if not facts.mission.has_bids:
            return Bids(groups)
        begun = begun_activations(facts, team)
        before, self._known = self._known, {}
        found = []
        for group in groups:
            activation = group[0].request.activation
            said, has_begun = facts.bids(activation), is_begun(facts, group, begun)
            known = before.get(activation)
            if (
                known is None
                or known.declared is not group
                or known.said is not said
                or known.has_begun is not has_begun
            ):
                known = _Known(group, said, has_begun, with_bids(facts, group, has_begun))
            self._known[activation] = known
            found.append(known.bids)
        return Bids.of(found, begun)
