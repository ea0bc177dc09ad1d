"""The mission in force, as it follows from the facts."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import pytest

from mrbt_mesh.core.facts.records import (
    ChildResult,
    Outcome,
    Proposal,
    ProposedStep,
    Record,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions import revise as numbering
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.formats.build import mission_from_yaml
from tests.support.commands import command

FILE = """
mission: line
local_tasks: {weld: {}, look: {}}
robot_types: {arm: {capabilities: {weld: 1, look: 1}}}
robots: {A1: arm, A2: arm, A3: arm}
global_tasks:
  weld: {needs: {weld: {min: 1}}}
  look: {needs: {look: {min: 1}}}
tree: %s
"""
TRAVEL = """
travel:
  places: {a: [0, 0], b: [3, 0]}
  speed: {arm: 1}
  start: {A1: a, A2: a, A3: a}
"""
RUN = "r"


def mission(tree: str) -> Mission:
    return mission_from_yaml(FILE % tree, "line.yaml", Path())


def driving(tree: str) -> Mission:
    """The same where the robots drive, so that the team may have schedules."""
    text = FILE.replace("{weld: {}, look: {}}", "{weld: {at: a}, look: {at: b}}") + TRAVEL
    return mission_from_yaml(text % tree, "line.yaml", Path())


BEFORE = mission("{Sequence: [weld, look]}")
AFTER = revise(BEFORE, mission("{Sequence: [look, weld]}"))
OTHER = revise(BEFORE, mission("look"))
SECOND = revise(AFTER, mission("weld"))


def entry(author: str, name: str, record: Record, number: int = 1) -> Entry:
    return make_entry(author, name, Version(Incarnation(1, author), number), record)


def proposed(found: Mission, stamp: int = 1) -> Entry:
    value = [compile_mission(found), False, False]
    return command(f"mission/{found.number}", value, stamp)


def adopted(found: Mission, author: str = "A2") -> Entry:
    return entry(author, f"mission_adopted/{found.number}", AdoptedMission(found.digest))


def held(author: str, found: Mission, problem: str = "", by: int = 0) -> Entry:
    record = HeldMission(found.number, found.digest, problem, by)
    return entry(author, "mission_held", record)


def facts(*entries: Entry) -> TeamFacts:
    found = TeamFacts(BEFORE, RUN)
    for each in entries:
        assert refusal_reason(each, found.in_force, RUN) is None, each.name
        found.map.merge([each])
    return found


DONE = entry("A3", f"outcome/{RUN}:1:weld::0/weld", Outcome(True, None))


@pytest.mark.parametrize("order", list(permutations(range(5))))
def test_the_same_facts_are_read_the_same_in_any_order(order: tuple[int, ...]) -> None:
    """The second revision does without the first one, which is dropped."""
    entries = [proposed(AFTER), adopted(AFTER), proposed(SECOND), adopted(SECOND), DONE]
    found = facts(*(entries[number] for number in order))
    found.prune()
    assert found.in_force == SECOND
    assert {each.name for each in found.map} == {"mission/2", "mission_adopted/2", DONE.name}
    assert found.has_outcome(f"{RUN}:1:weld::0")


def test_it_is_in_force_once_that_and_the_mission_are_known() -> None:
    assert facts(proposed(AFTER)).in_force is BEFORE
    assert facts(adopted(AFTER)).in_force is BEFORE
    assert facts(adopted(OTHER), proposed(AFTER)).in_force is BEFORE
    assert facts(adopted(AFTER), proposed(AFTER)).in_force == AFTER


def test_what_has_no_place_in_it_is_kept_and_does_nothing_until_it_has_one() -> None:
    look = entry("A3", f"outcome/{RUN}:2:look::0/look", Outcome(True, None))
    weld, back = DONE, revise(OTHER, BEFORE)
    found = facts(weld, look, proposed(OTHER), adopted(OTHER))
    found.prune()
    assert found.map.get("A3", weld.name) == weld
    assert [each.name for each in found.unbelieved()] == [weld.name]
    assert found.has_outcome(f"{RUN}:2:look::0")
    assert not found.has_outcome(f"{RUN}:1:weld::0")
    found.map.merge([proposed(back), adopted(back)])
    assert found.has_outcome(f"{RUN}:1:weld::0")
    assert not [*found.unbelieved()]


def test_what_no_revision_can_have_a_place_for_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    """So are parts that were removed so long ago that no mission knows their numbers."""
    monkeypatch.setattr(numbering, "MAX_RETIRED", 0)
    other = revise(BEFORE, mission("look"))
    found = facts(DONE, proposed(other), adopted(other))
    assert (DONE.author, DONE.name) in found.prune()
    assert found.map.get("A3", DONE.name) is None


def test_a_newer_fact_of_the_same_name_is_not_dropped() -> None:
    """It came with the revision, before what has no place was set aside."""
    before = driving("{Sequence: [weld, look]}")
    other = revise(before, driving("look"))
    schedules = [
        Proposal((ProposedStep(f"{RUN}:{node}:{task}::0", (("A1",),)),))
        for node, task in ((1, "weld"), (2, "look"))
    ]
    old, new = (entry("A3", "schedule", each, n) for n, each in enumerate(schedules, 1))
    found = TeamFacts(before, RUN)
    found.map.merge([old, proposed(other), adopted(other)])
    assert not found.proposals
    found.map.merge([new])
    assert ("A3", "schedule") not in found.prune()
    assert found.proposals["A3"] == schedules[1]
    again = revise(other, driving("{Sequence: [look, weld]}"))
    found = TeamFacts(before, RUN)
    found.map.merge([old, proposed(other), adopted(other)])
    found.map.merge([new])
    found.map.merge([proposed(again), adopted(again)])
    assert found.map.get("A3", "schedule") == new


def test_all_must_hold_the_same_proposal() -> None:
    all_hold = [held(robot, AFTER) for robot in BEFORE.robots]
    known, robots = facts(proposed(AFTER), *all_hold), BEFORE.robots
    assert known.index(Revisions).is_held_by_all(AFTER, robots)
    known = facts(proposed(AFTER), *all_hold[1:])
    assert not known.index(Revisions).is_held_by_all(AFTER, robots)


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ((command("mission_withdrawn/1", True),), "it was withdrawn"),
        ((held("A2", AFTER, "it works on weld"),), "A2: it works on weld"),
        (
            (held("A2", AFTER), proposed(OTHER, 2), held("A3", OTHER)),
            "two revisions were proposed at the same time; propose one of them again",
        ),
    ],
)
def test_a_proposal_can_be_void(more: tuple[Entry, ...], why: str) -> None:
    pending = facts(proposed(AFTER)).index(Revisions).pending(0)
    assert pending is not None
    assert pending[1] == AFTER
    found = facts(proposed(AFTER), *more).index(Revisions)
    assert found.pending(0) is None
    assert found.void_reason(1) == why


def test_of_two_proposals_the_earlier_one_counts() -> None:
    pending = facts(proposed(OTHER, 1), proposed(AFTER, 2)).index(Revisions).pending(0)
    assert pending is not None
    assert pending[1] == OTHER


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("mission/x", compile_mission(AFTER), "'x' is not a number of a revision"),
        ("mission/2", compile_mission(AFTER), "revision 2 is one of another mission"),
        ("mission/1", compile_mission(BEFORE), "revision 1 is one of another mission"),
        ("mission/1", "{}", "a revision that cannot be read"),
    ],
)
def test_no_other_mission_is_accepted(name: str, text: str, why: str) -> None:
    given = command(name, [text, False, False])
    assert why in (refusal_reason(given, BEFORE, RUN) or "")


@pytest.mark.parametrize(
    "given",
    [
        entry("A3", f"outcome/{RUN}:1:weld::0/weld/A3", Outcome(True, None)),
        entry("A3", f"passed/{RUN}:0:::0/first", ChildResult(True)),
    ],
    ids=lambda given: given.parts[0],
)
def test_what_cannot_be_read_in_any_mission_is_refused(given: Entry) -> None:
    """What a revision has no place for is kept, and read for what the next revision repeats."""
    assert refusal_reason(given, AFTER, RUN) is not None
