"""What the facts make of jobs: their order, which are in the tree, what is kept of ended ones."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.jobs import KEPT_ENDS, hash_of
from mrbt_mesh.core.facts.records import (
    MAX_ARCHIVED,
    Claim,
    Job,
    JobArchive,
    JobChange,
    JobEnd,
    JobState,
    Phase,
    Record,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.formats.build import mission_from_yaml

MISSION = mission_from_yaml(
    """
mission: m
ends: never
local_tasks: {take: {parameters: [what]}}
robot_types: {cart: {capabilities: {take: 1}}}
robots: {A: cart, B: cart}
global_tasks: {fetch: {parameters: [what], needs: {take($what): {min: 1}}}}
jobs:
  bring: {parameters: {what: {min: 1, max: 9}}, tree: fetch($what)}
  tidy: {parameters: {what: {min: 1, max: 9}}, priority: 3, tree: fetch($what)}
tree: {Jobs: {types: [bring, tidy], at_most: 2}}
""",
    "m.yaml",
    Path(),
)
LIFE = Incarnation(1, "x")


def entry(author: str, name: str, record: Record, sequence: int = 1) -> Entry:
    return make_entry(author, name, Version(LIFE, sequence), record)


def job(kind: str = "bring", stamp: int = 1, priority: int = 0, what: str = "1") -> Job:
    return Job(kind, (what,), priority, 0, 0, "me", stamp)


def end(state: JobState = JobState.SUCCEEDED, stamp: int = 1) -> JobEnd:
    return JobEnd(state, "bring", ("1",), "me", "", (), stamp)


def facts_with(*entries: Entry) -> TeamFacts:
    facts = TeamFacts(MISSION, "r")
    facts.map.merge(entries)
    return facts


def in_tree(facts: TeamFacts) -> list[str]:
    assert facts.jobs is not None
    return [each.id for each in facts.jobs.in_tree()]


def claim(name: str, what: str = "1") -> Claim:
    activation = f"r:2@{name}:fetch({what})::0"
    return Claim(activation, f"fetch({what})", f"take({what})", Phase.RUNNING, 1)


def test_larger_priorities_go_first_then_earlier_ones_and_so_many_of_each_type() -> None:
    facts = facts_with(
        entry("A", "job/c", job(stamp=3)),
        entry("A", "job/b", job(stamp=2, priority=5)),
        entry("B", "job/a", job(stamp=1)),
        entry("B", "job/t", job("tidy", stamp=9, priority=3)),
    )
    assert in_tree(facts) == ["b", "t", "a"]
    facts.map.merge([entry("B", "job_change/c", JobChange(False, 9, 4))])
    assert in_tree(facts) == ["c", "b", "t"]


def test_what_is_begun_stays_in_the_tree() -> None:
    facts = facts_with(entry("A", "job/a", job(stamp=1)), entry("A", "claim", claim("a")))
    facts.map.merge([entry("B", f"job/u{n}", job(stamp=n + 2, priority=9)) for n in range(3)])
    assert in_tree(facts) == ["u0", "a"]
    facts.map.merge([entry("B", "job_change/a", JobChange(True, None, 9))])
    assert in_tree(facts) == ["u0", "a"], "to hold a job stops nothing that goes on"


def test_the_first_submission_of_an_id_counts_and_success_before_a_cancellation() -> None:
    facts = facts_with(
        entry("B", "job/a", job(stamp=2, what="2")), entry("A", "job/a", job(stamp=2, what="1"))
    )
    (found,) = (node.subject for node in facts.mission.tree.actions())
    assert found == "fetch(1)"
    facts.map.merge([entry("A", "job_end/a", end(JobState.CANCELLED))])
    facts.map.merge([entry("B", "job_end/a", end(JobState.SUCCEEDED))])
    assert facts.jobs is not None
    known = facts.jobs.known["a"].end
    assert known is not None
    assert known.state is JobState.SUCCEEDED
    assert in_tree(facts) == []


def test_of_an_ended_job_only_its_end_is_kept() -> None:
    facts = facts_with(
        entry("A", "job/a", job()),
        entry("A", "job_change/a", JobChange(True, None, 1)),
        entry("A", "outcome/r:2@a:fetch(1)::0/take(1)", end_of_work()),
        entry("B", "job_end/a", end()),
    )
    facts.prune()
    assert [each.name for each in facts.map] == ["job_end/a"]
    facts.map.merge([entry("B", "job/a", job()), entry("B", "claim", claim("a"), 2)])
    facts.prune()
    assert {each.name for each in facts.map} == {"job_end/a", "claim"}, "late news is dropped"
    assert in_tree(facts) == []


def end_of_work() -> Record:
    found: Record = parse_entry(
        "A", "outcome/r:2@a:fetch(1)::0/take(1)", Version(LIFE, 1), [True, None]
    ).record
    return found


def test_long_ended_jobs_are_archived_and_never_begin_again() -> None:
    facts, count = TeamFacts(MISSION, "r"), KEPT_ENDS + MAX_ARCHIVED + 1
    assert facts.jobs is not None
    for number in range(count):
        facts.map.merge([entry("A", f"job_end/j{number}", end(stamp=number))])
    archive = facts.jobs.to_archive()
    assert archive is not None
    number, record = archive
    assert [*record.hashes] == sorted(hash_of(f"j{n}") for n in range(MAX_ARCHIVED))
    facts.map.merge([entry("B", f"job_archive/{number}", record)])
    facts.prune()
    assert len(facts.map) == KEPT_ENDS + 2
    assert facts.jobs.to_archive() is None
    facts.map.merge([entry("B", "job/j0", job()), entry("B", "job/j900", job())])
    assert in_tree(facts) == []
    facts.prune()
    assert len(facts.map) == KEPT_ENDS + 2


ENTRIES = [
    entry("A", "job/a", job(stamp=1)),
    entry("B", "job/a", job(stamp=1, what="2")),
    entry("A", "job/b", job(stamp=2, priority=2)),
    entry("A", "job/c", job("tidy", stamp=3)),
    entry("B", "job/d", job(stamp=4)),
    entry("A", "job_change/b", JobChange(True, None, 5)),
    entry("B", "job_change/b", JobChange(False, -1, 6)),
    entry("A", "job_end/c", end(JobState.CANCELLED)),
    entry("B", "job_end/c", end(JobState.FAILED)),
    entry("A", "claim", claim("d")),
    entry("A", "claim", claim("b"), 2),
    entry("B", "job_archive/1", JobArchive((hash_of("e"),))),
    entry("A", "job/e", job(stamp=7)),
]


@given(st.permutations(ENTRIES), st.lists(st.integers(0, len(ENTRIES) - 1)))
def test_the_order_in_which_facts_arrive_makes_no_difference(
    order: list[Entry], looks: list[int]
) -> None:
    facts = TeamFacts(MISSION, "r")
    for number, each in enumerate(order):
        assert refusal_reason(each, MISSION, "r") is None
        facts.map.merge([each])
        if number in looks:
            facts.prune()
            in_tree(facts)
    facts.prune()
    again = facts_with(*ENTRIES)
    again.prune()
    assert facts.map.digest() == again.map.digest()
    assert in_tree(facts) == in_tree(again) == ["a", "b"]
    assert facts.mission.tree == again.mission.tree


def test_facts_of_jobs_that_the_mission_could_not_have_are_refused() -> None:
    wrong = [
        entry("A", "job/a", job("paint")),
        entry("A", "job/a", job(what="10")),
        entry("A", "job/a b", job()),
        entry("A", "job_archive/x", JobArchive(())),
        entry("A", "outcome/r:2@a:fetch(10)::0/take(10)", end_of_work()),
        entry("A", "outcome/r:2:fetch({what})::0/take({what})", end_of_work()),
        entry("A", "outcome/r:0@a:::0/take(1)", end_of_work()),
    ]
    for each in wrong:
        assert refusal_reason(each, MISSION, "r") is not None, each.name
    assert MISSION.tree.nodes[0].kind is Kind.JOBS
