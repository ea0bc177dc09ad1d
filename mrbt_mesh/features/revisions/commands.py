"""Revisions in simulations, as an operator's client proposes them and waits for them."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.changes import as_revision
from mrbt_mesh.features.revisions.facts import Revisions, read_mission
from mrbt_mesh.features.revisions.kinds import MISSION, MISSION_WITHDRAWN
from mrbt_mesh.features.revisions.revise import RevisionError, revise
from mrbt_mesh.sim.world.faults import Revise
from mrbt_mesh.sim.world.team_commands import Propose


def robots_of(fault: Revise) -> Collection[str]:
    """The robots of the mission that a fault proposes."""
    return read_mission(fault.mission).robots


def next_revision(facts: TeamFacts, mission: Mission) -> Mission | str:
    """The mission as the next revision, or why it cannot be one."""
    try:
        return as_revision(facts, mission)
    except RevisionError as error:
        return str(error)


def revision_of(facts: TeamFacts, fault: Revise) -> Mission:
    """The mission that a fault proposes as the next revision."""
    number = facts.index(Revisions).last_number + 1
    return revise(facts.in_force, read_mission(fault.mission), number)


def proposal(revision: Mission, given: Revise | Propose) -> tuple[str, str, list[Any]]:
    """The field of the command that proposes a revision, its subject and its value."""
    value = [compile_mission(revision), given.is_forced, given.repeats_exclusive]
    return MISSION, str(revision.number), value


def withdrawal(revision: Mission) -> str:
    """The name of the command that withdraws a proposal."""
    return f"{MISSION_WITHDRAWN}/{revision.number}"


def is_in_force(facts: TeamFacts, revision: Mission) -> bool:
    """Whether a revision is in force, or a later one."""
    return facts.in_force.number >= revision.number


def void_reason(facts: TeamFacts, revision: Mission) -> str:
    """Why a proposal can no longer be adopted; empty if it can."""
    return facts.index(Revisions).void_reason(revision.number)


def awaited(facts: TeamFacts, revision: Mission, robots: Collection[str]) -> list[str]:
    """The robots that must still hold a revision which is not in force; sorted."""
    in_force = facts.in_force.number
    return facts.index(Revisions).awaited(revision.number, in_force, robots)
