"""What a compiled mission says of itself if it is a revision."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

from mrbt_mesh.core.feature import Succession
from mrbt_mesh.core.mission.compiled import DIGEST_LENGTH
from mrbt_mesh.core.mission.mission import MAX_NUMBER, Mission
from mrbt_mesh.features.revisions.kinds import SECTION


class RetiredPart(NamedTuple):
    """A part of an earlier tree that the mission in force lacks, and the numbers of its nodes.

    `key`: a hash of all that its steps depend on. `guards`: the numbers of the nodes whose
    conditions decide together whether it is reached.
    """

    key: str
    nodes: tuple[int, ...]
    guards: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Revision(Succession):
    """What a mission is that a running team takes up in the place of another one.

    `number`: 1 for the first one. `next_node`: all smaller numbers of nodes are used up. `numbers`:
    those of the nodes of its tree. `retired`: parts that earlier missions had, the last removed at
    the end.
    """

    number: int
    team: str
    next_node: int
    numbers: tuple[int, ...]
    retired: tuple[RetiredPart, ...] = ()

    def keeps_number(self, number: int) -> bool:
        return number >= self.next_node or any(
            number in part.nodes or number in part.guards for part in self.retired
        )


def revision_of(mission: Mission) -> Revision | None:
    """What a mission says of itself as a revision; None: it is none."""
    found = mission.sections.get(SECTION)
    assert found is None or isinstance(found, Revision)
    return found


def with_revision(mission: Mission, revision: Revision) -> Mission:
    """The mission as this revision."""
    tree = mission.tree.with_numbers(revision.numbers)
    return replace(mission, tree=tree, sections={**mission.sections, SECTION: revision})


def without_revision(mission: Mission) -> Mission:
    """The mission as if a team were started with it; its nodes keep their numbers."""
    sections = {name: known for name, known in mission.sections.items() if name != SECTION}
    return replace(mission, sections=sections)


def problem(known: Revision) -> str | None:
    """What is wrong with a revision in a damaged mission."""
    if not 1 <= known.number <= MAX_NUMBER:
        return f"revision {known.number}"
    if len(known.team) != DIGEST_LENGTH:
        return "digest of the team"
    if min(known.numbers) < 0 or not max(known.numbers) < known.next_node <= MAX_NUMBER:
        return "numbers of nodes"
    for key, *kept in known.retired:
        used = [number for numbers in kept for number in numbers]
        if len(key) > DIGEST_LENGTH or not all(0 <= each < known.next_node for each in used):
            return "retired parts"
    return None
