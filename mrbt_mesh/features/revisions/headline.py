"""What people are told of a team whose mission is about to be another one."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.names import name_order
from mrbt_mesh.core.planning.plan import shortened
from mrbt_mesh.features.revisions.facts import Revisions


def warnings(facts: TeamFacts, robots: Collection[str]) -> Iterator[str]:
    """Another mission is on its way: until all `robots` act by it nobody begins anything."""
    revisions, in_force = facts.index(Revisions), facts.in_force.number
    if not revisions.is_used:
        return

    def awaited(number: int) -> str:
        found = revisions.awaited(number, in_force, robots)
        return shortened(sorted(found, key=name_order))

    if (pending := revisions.pending(in_force)) is not None:
        number = pending[1].number
        by = revisions.proposer(number)
        yield (
            f"revision {number} is proposed by {by}, no robot begins anything: "
            f"waiting for {awaited(number) or 'a majority'} (`mrbt revise --withdraw` ends it)"
        )
    elif names := awaited(in_force):
        yield f"revision {in_force} is in force, waiting for {names}"
