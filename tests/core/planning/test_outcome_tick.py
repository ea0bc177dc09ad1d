"""What follows from the tick in which an action returns, for its robot and those who hear of it."""

from __future__ import annotations

from array import array
from pathlib import Path

import pytest

from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.jobs import hash_of
from mrbt_mesh.core.facts.records import (
    ConditionValue,
    JobArchive,
    JobEnd,
    JobState,
    NoClaim,
    Outcome,
    Record,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.wire import Header, MessageKind, encode, pack_entries
from mrbt_mesh.core.planning.make_plan import make_plan
from mrbt_mesh.core.planning.outcome_tick import facts_of_tick, shown_by_tick
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.observer import Observer
from tests.support.commands import submission
from tests.support.harness import TIMING

MISSION = mission_from_yaml(
    """
mission: m
ends: never
local_tasks: {look: {}, take: {}}
robot_types: {cart: {capabilities: {look: 1, take: 1}}}
robots: {A: cart, B: cart, C: cart}
conditions: {red: {default: false}}
global_tasks: {look: {needs: {look: {}}}, take: {needs: {take: {}}}}
jobs:
  sort: {tree: {Sequence: [look, {Condition: red}, take]}}
  fetch: {tree: {Sequence: [{Inverter: {Condition: red}}, take]}}
tree: {Jobs: all}
""",
    "m.yaml",
    Path(),
)
LIFE = Incarnation(1, "n")


def entry(author: str, name: str, record: Record, number: int = 2) -> Entry:
    return make_entry(author, name, Version(LIFE, number), record)


def facts_with(*entries: Entry) -> TeamFacts:
    facts = TeamFacts(MISSION, "r")
    facts.map.merge(entries)
    return facts


def batch_of(facts: TeamFacts, task: str, red: bool | None) -> list[Entry]:
    """What B writes when it has done a task of the one open job, and has set `red` then."""
    plan = make_plan(facts, {"A": LIFE, "B": LIFE, "C": LIFE}, default_solver)
    (request,) = plan.evaluation.requests
    name, version = f"outcome/{request.activation}/{task}", Version(LIFE, 2)
    status = facts.status_after(name, "B", True, version)
    values = {} if red is None else {"red": red}
    follows = facts_of_tick(facts, "B", request.activation, status, values)
    sets = [(f"condition/{each}", ConditionValue(value, 1, 5)) for each, value in values.items()]
    return [entry("B", *each) for each in ((name, Outcome(True, None, "")), *follows, *sets)]


def ends_in(batch: list[Entry]) -> list[JobEnd]:
    return [each.record for each in batch if isinstance(each.record, JobEnd)]


def test_the_end_of_a_job_names_the_robot_whose_outcome_ends_it() -> None:
    facts = facts_with(submission("j", "sort"))
    batch = batch_of(facts, "look", False)
    (end,) = ends_in(batch)
    assert (end.state, end.robots) == (JobState.FAILED, ("B",))


def test_those_who_hear_of_the_tick_come_to_the_same_facts() -> None:
    facts = facts_with(submission("j", "sort"))
    batch = batch_of(facts, "look", False)
    assert "job_end/j" in shown_by_tick(facts, batch)
    lie = JobEnd(JobState.SUCCEEDED, "sort", (), "me", "", ("B",), 9)
    others = [each for each in batch if not isinstance(each.record, JobEnd)]
    assert "job_end/j" not in shown_by_tick(facts, [*others, entry("B", "job_end/j", lie)])


def watching() -> Observer:
    return Observer(MISSION, "r", TIMING, default_solver)


def published(author: str, *entries: Entry) -> bytes:
    header = Header(MISSION.team_digest[:16], "m", "r", author)
    return encode(header, MessageKind.FACT, pack_entries(entries))


@pytest.mark.parametrize(
    ("kind", "task", "red"), [("sort", "look", False), ("fetch", "take", True)]
)
def test_an_observer_takes_in_an_end_that_only_the_tick_shows(
    kind: str, task: str, red: bool
) -> None:
    """A condition that stood left of the action has been read before it turned."""
    observer, job = watching(), submission("j", kind)
    batch = batch_of(facts_with(job), task, red)
    observer.message(MessageKind.FACT, "A", published("A", job), 1)
    observer.message(MessageKind.FACT, "B", published("B", *batch), 2)
    observer.update(3)
    assert ends_in(batch)
    jobs = observer.facts.jobs
    assert jobs is not None
    assert jobs.count_open() == 0


def robot(name: str, *entries: Entry) -> Replica:
    header = Header(MISSION.team_digest[:16], "m", "r", name)
    found = Replica(TeamFacts(MISSION, "r"), header, TIMING, "n")
    found.restore(entries)
    return found


def test_one_that_comes_later_knows_the_jobs_whose_facts_were_dropped() -> None:
    """Two have written an end; another robot that holds an archive confirms it."""
    first = JobEnd(JobState.SUCCEEDED, "sort", (), "me", "", ("A",), 7)
    hashes = array("Q", sorted(map(hash_of, ("j1", "j2"))))
    archive = JobArchive(hashes, array("Q", [0, 0]))
    held = [
        submission("j0", "sort"),
        entry("A", "job_end/j0", first),
        entry("B", "job_end/j0", first),
        entry("A", "job_archive/1", archive),
        entry("A", "claim", NoClaim("")),
    ]
    late = watching()
    late.message(MessageKind.FACT, "A", published("A", submission("j0", "sort")), 1)
    for number, name in enumerate(("A", "B")):
        pull = late.replica.write_pull()
        for page in robot(name, *held).answer_pull(pull):
            late.state(name, page, 10 + number)
        late.update(20 + number)
        jobs = late.facts.jobs
        assert jobs is not None
        assert (jobs.count_archived(), jobs.count_open()) == ((0, 0), (2, 0))[number]
