"""Revisions: another mission in the place of the one that a team runs (`mrbt revise`)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.feature import CommandField, Feature, Kit, Part
from mrbt_mesh.features.revisions.kinds import (
    KINDS,
    MISSION,
    MISSION_ADOPTED,
    MISSION_HELD,
    MISSION_WITHDRAWN,
    SECTION,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.bt.tree import Tree
    from mrbt_mesh.core.facts.records import Record
    from mrbt_mesh.core.facts.store import Entry
    from mrbt_mesh.core.facts.team_facts import TeamFacts
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.features.revisions.checker import Revised
    from mrbt_mesh.features.revisions.facts import Revisions
    from mrbt_mesh.features.revisions.records import ProposedMission
    from mrbt_mesh.features.revisions.section import Revision
    from mrbt_mesh.sim.checkers.findings import RunFindings


def _proposal(value: Any) -> ProposedMission:
    from mrbt_mesh.features.revisions.records import ProposedMission

    return ProposedMission.parse(value)


def _withdrawal(value: Any) -> bool:
    from mrbt_mesh.core.facts.records import read_true

    return read_true(value)


class RevisedMissions(Feature):
    """The feature. Any team may get a revision, so no mission file declares it."""

    section = SECTION
    commands = {  # noqa: RUF012
        MISSION: CommandField(_proposal, 2, once=True),
        MISSION_WITHDRAWN: CommandField(_withdrawal, 2, is_shown=False),
    }
    team_kinds = {MISSION_ADOPTED: 2, MISSION_HELD: 1}  # noqa: RUF012
    derived = frozenset({MISSION_ADOPTED})
    in_any_mission = KINDS

    def section_type(self) -> Any:
        from mrbt_mesh.features.revisions.section import Revision

        return Revision

    def problem(self, section: Revision, mission: Mission) -> str | None:
        from mrbt_mesh.features.revisions.section import problem

        return problem(section)

    def succession(self, section: Revision) -> Revision:
        return section

    def numbered(self, section: Revision, tree: Tree) -> Tree:
        return tree.with_numbers(section.numbers)

    def parse(self, kind: str, value: Any) -> Record:
        from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission

        return (AdoptedMission if kind == MISSION_ADOPTED else HeldMission).parse(value)

    def misplaced(self, entry: Entry, mission: Mission) -> str:
        from mrbt_mesh.features.revisions.facts import misplaced

        return misplaced(entry, mission)

    def index(self, mission: Mission) -> Revisions:
        from mrbt_mesh.features.revisions.facts import Revisions

        return Revisions(mission)

    def parts(self, kit: Kit, before: Sequence[Part], now_us: int) -> Sequence[Part]:
        from mrbt_mesh.features.revisions.reviser import Reviser

        return before or (Reviser(kit),)

    def warnings(self, facts: TeamFacts, robots: Collection[str]) -> Iterator[str]:
        from mrbt_mesh.features.revisions.headline import warnings

        return warnings(facts, robots)

    def checkers(self, run: RunFindings) -> Sequence[Revised]:
        from mrbt_mesh.features.revisions.checker import Revised

        return (Revised(run),)


FEATURE = RevisedMissions()
