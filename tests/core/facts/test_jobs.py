"""What the facts make of jobs: their order, which are in the tree, what is kept of ended ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.facts.jobs import KEPT_ENDS, hash_of
from mrbt_mesh.core.facts.records import (
    LATCH,
    MAX_ARCHIVED,
    Claim,
    JobArchive,
    JobEnd,
    JobState,
    Phase,
    Record,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, make_entry, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import refusal_reason
from mrbt_mesh.formats.build import mission_from_yaml
from tests.support.commands import command, submission

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
OF_A = "outcome/r:2@a:fetch(1)::0/take(1)"
DONE = parse_entry("A", OF_A, Version(LIFE, 1), [True, None]).record


def entry(author: str, name: str, record: Record, sequence: int = 1) -> Entry:
    return make_entry(author, name, Version(LIFE, sequence), record)


def job(
    name: str,
    kind: str = "bring",
    stamp: int = 1,
    priority: int = 0,
    what: str = "1",
    deadline_us: int = 0,
) -> Entry:
    return submission(name, kind, what, priority=priority, stamp=stamp, deadline_us=deadline_us)


def hold(name: str, how: str = "held", stamp: int = 9) -> Entry:
    return command(f"job_hold/{name}", how, stamp)


def cancelled(name: str, stamp: int = 9) -> Entry:
    return command(f"job_cancelled/{name}", True, stamp)


def end(
    state: JobState = JobState.SUCCEEDED, stamp: int = 1, robots: tuple[str, ...] = ()
) -> JobEnd:
    return JobEnd(state, "bring", ("1",), "me", "", robots, stamp)


def facts_with(*entries: Entry) -> TeamFacts:
    facts = TeamFacts(MISSION, "r")
    facts.map.merge(entries)
    return facts


def in_tree(facts: TeamFacts) -> list[str]:
    assert facts.mission, "it follows the jobs first"
    assert facts.jobs is not None
    return [each.id for each in facts.jobs.in_tree()]


def claim(name: str, what: str = "1") -> Claim:
    activation = f"r:2@{name}:fetch({what})::0"
    return Claim(activation, f"fetch({what})", f"take({what})", Phase.RUNNING, 1)


def test_larger_priorities_go_first_then_earlier_ones_and_so_many_of_each_type() -> None:
    facts = facts_with(
        job("c", stamp=3),
        job("b", stamp=2, priority=5),
        job("a", stamp=1),
        job("t", "tidy", stamp=9, priority=3),
    )
    assert in_tree(facts) == ["b", "t", "a"]
    facts.map.merge([command("job_priority/c", 9, 10)])
    assert in_tree(facts) == ["c", "b", "t"]


def test_what_is_begun_stays_in_the_tree() -> None:
    facts = facts_with(job("a"), entry("A", "claim", claim("a")))
    facts.map.merge([job(f"u{n}", stamp=n + 2, priority=9) for n in range(3)])
    assert in_tree(facts) == ["u0", "a"]
    facts.map.merge([hold("a")])
    assert in_tree(facts) == ["u0", "a"], "what runs of a job that is held goes on"


def test_the_first_submission_of_an_id_counts_and_success_before_a_failure() -> None:
    facts = facts_with(job("a", stamp=3, what="2"), job("a", stamp=2, what="1"))
    (found,) = (node.subject for node in facts.mission.tree.actions())
    assert found == "fetch(1)"
    facts.map.merge([entry("A", "job_end/a", end(JobState.FAILED))])
    facts.map.merge([entry("B", "job_end/a", end(JobState.SUCCEEDED))])
    assert facts.jobs is not None
    known = facts.jobs.known["a"].end
    assert known is not None
    assert known.state is JobState.SUCCEEDED
    assert in_tree(facts) == []


def test_a_cancellation_stays_visible_when_the_job_is_done_all_the_same() -> None:
    facts = facts_with(job("a"), entry("A", "claim", claim("a")))
    facts.map.merge([cancelled("a")])
    assert facts.jobs is not None
    known = facts.jobs.known["a"]
    assert in_tree(facts) == []
    assert known.end is not None
    assert known.end.state is JobState.CANCELLED
    assert [each.id for each in facts.jobs.cancelled()] == ["a"], "robots have yet to write its end"
    facts.map.merge([entry("A", "job_end/a", end(JobState.CANCELLED, 10))])
    assert facts.jobs.cancelled() == []
    assert known.done_all_the_same == ()
    facts.map.merge([entry("B", "job_end/a", end(robots=("B",)))])
    facts.prune()
    assert known.end.state is JobState.CANCELLED
    assert known.done_all_the_same == ("B",)
    assert [each.id for each in facts.jobs.overruled()] == ["a"]
    assert known.overruled_text == "done all the same by B, which was cut off"
    assert {each.name for each in facts.map} == {"claim", "job_end/a", "job_cancelled/a"}


def test_that_a_job_was_cancelled_is_not_believed_of_a_robot() -> None:
    facts = facts_with(job("a"), entry("B", "job_end/a", end(JobState.CANCELLED)))
    facts.prune()
    assert in_tree(facts) == ["a"]
    facts.map.merge([cancelled("a")])
    facts.prune()
    assert in_tree(facts) == []
    assert {each.name for each in facts.map} == {"job_end/a", "job_cancelled/a"}


def test_of_an_ended_job_only_its_end_is_kept() -> None:
    facts = facts_with(
        job("a"),
        hold("a"),
        entry("A", OF_A, DONE),
        entry("A", "job_end/a", end()),
    )
    assert facts.jobs is not None
    facts.prune()
    assert facts.jobs.has_ended("a")
    assert len(facts.map) == 4, "the others are kept until another robot has written the end too"
    assert [each.id for each in facts.jobs.unsettled()] == ["a"]
    facts.map.merge([entry("B", "job_end/a", end())])
    facts.prune()
    assert [each.name for each in facts.map] == ["job_end/a", "job_end/a"]
    facts.map.merge([job("a"), entry("B", "claim", claim("a"), 2)])
    facts.prune()
    assert {each.name for each in facts.map} == {"job_end/a", "claim"}, "late news is dropped"
    assert in_tree(facts) == []


WORK = entry("B", OF_A, DONE)
OF_ANOTHER = entry("A", OF_A, DONE)
FAILED = entry("A", "latched_failure/r:2@a:fetch(1)::0", LATCH)
OVER = entry("A", "expired/r:1@a:::0", LATCH)


@pytest.mark.parametrize(
    ("shown", "state", "counts"),
    [
        (None, JobState.SUCCEEDED, False),
        (WORK, JobState.SUCCEEDED, True),
        (WORK, JobState.FAILED, True),
        (OF_ANOTHER, JobState.SUCCEEDED, False),
        (FAILED, JobState.SUCCEEDED, False),
        (FAILED, JobState.FAILED, True),
        (OVER, JobState.FAILED, True),
        (WORK, JobState.EXPIRED, False),
    ],
)
def test_one_robot_ends_a_job_if_it_returned_from_work_in_it_or_that_has_failed(
    shown: Entry | None, state: JobState, counts: bool
) -> None:
    facts = facts_with(job("a"), entry("B", "job_end/a", end(state)))
    facts.map.merge([shown] if shown is not None else [])
    assert facts.jobs is not None
    assert facts.jobs.has_ended("a") is counts
    assert in_tree(facts) == ([] if counts else ["a"])
    facts.map.merge([entry("A", "job_end/a", end(JobState.FAILED))])
    assert facts.jobs.has_ended("a"), "two say so"
    facts.prune()
    assert len(facts.map) == 2


@pytest.mark.parametrize("deadline_us", [0, 9])
def test_one_robot_may_say_that_a_deadline_has_passed(deadline_us: int) -> None:
    submitted = job("a", deadline_us=deadline_us)
    facts = facts_with(submitted, entry("B", "job_end/a", end(JobState.EXPIRED)))
    assert in_tree(facts) == ([] if deadline_us else ["a"])


def test_an_end_counts_before_its_job_is_known_if_two_say_so() -> None:
    facts = facts_with(entry("B", "job_end/a", end()))
    facts.map.merge([job("a")])
    assert in_tree(facts) == ["a"]
    facts.map.merge([entry("A", "job_end/a", end())])
    assert in_tree(facts) == []


def test_long_ended_jobs_are_archived_and_never_begin_again() -> None:
    facts, count = TeamFacts(MISSION, "r"), KEPT_ENDS + MAX_ARCHIVED + 1
    assert facts.jobs is not None
    for number in range(count):
        facts.map.merge([entry(each, f"job_end/j{number}", end(stamp=number)) for each in "AB"])
    archive = facts.jobs.to_archive(0)
    assert archive is not None
    number, record = archive
    assert [*record.hashes] == sorted(hash_of(f"j{n}") for n in range(MAX_ARCHIVED))
    facts.map.merge([entry("B", f"job_archive/{number}", record)])
    facts.prune()
    assert facts.jobs.archived_end("j0") is JobState.SUCCEEDED
    assert facts.jobs.archived_end("j900") is None, "it is in no archive"
    assert JobArchive.parse(record.to_value()) == record
    assert len(facts.map) == 2 * (KEPT_ENDS + 1) + 1
    assert facts.jobs.to_archive(0) is None
    facts.map.merge([job("j0"), job("j900")])
    assert in_tree(facts) == []
    facts.prune()
    assert len(facts.map) == 2 * (KEPT_ENDS + 1) + 1


ENTRIES = [
    job("a", stamp=1),
    job("a", stamp=2, what="2"),
    job("b", stamp=2, priority=2),
    job("c", "tidy", stamp=3),
    job("d", stamp=4),
    hold("b", "held", 5),
    hold("b", "released", 6),
    hold("b", "now", 4),
    command("job_priority/b", -1, 6),
    command("job_priority/b", 7, 5),
    command("job_priority/b", 8, 6, "a"),
    cancelled("c"),
    cancelled("c", 8),
    entry("A", "job_end/c", end(JobState.CANCELLED)),
    entry("B", "job_end/c", end(JobState.FAILED)),
    job("f", stamp=1),
    entry("B", "job_end/f", end()),
    entry("B", "outcome/r:2@f:fetch(1)::0/take(1)", DONE),
    job("g", stamp=1),
    entry("A", "job_end/g", end(JobState.FAILED)),
    entry("B", "job_end/g", end(JobState.FAILED)),
    entry("A", "claim", claim("d")),
    entry("A", "claim", claim("b"), 2),
    entry("B", "job_archive/1", JobArchive((hash_of("e"),), (7,))),
    entry("A", "job_archive/1", JobArchive((hash_of("e"),), (7,), "c")),
    job("e", stamp=7),
]


@given(st.permutations([*ENTRIES, *ENTRIES[::3]]), st.lists(st.integers(0, len(ENTRIES) - 1)))
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


@pytest.mark.parametrize(
    ("ends", "found"),
    [
        (("s", "s"), JobState.SUCCEEDED),
        (("c", ""), JobState.CANCELLED),
        (("f", "e"), None),
        (("", ""), None),
    ],
)
def test_how_a_job_ended_long_ago_is_what_no_archive_contradicts(
    ends: tuple[str, str], found: JobState | None
) -> None:
    records = [JobArchive((hash_of("e"),), (7,), each) for each in ends]
    archives = [
        entry(author, "job_archive/1", record) for author, record in zip("AB", records, strict=True)
    ]
    jobs = facts_with(*archives).jobs
    assert jobs is not None
    assert jobs.archived_end("e") is found


@pytest.mark.parametrize(
    "value",
    [
        [[1], [7], "x"],
        [[1], [7], ""],
        [[1], [7], "ss"],
        [[1], [7], 7],
        [[1], [7], "s", "s"],
        [[1]],
        7,
    ],
)
def test_a_malformed_archive_is_refused(value: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        JobArchive.parse(value)


def test_facts_of_jobs_that_the_mission_could_not_have_are_refused() -> None:
    wrong = [
        job("a", "paint"),
        job("a", what="10"),
        job("a b"),
        hold("a b"),
        entry("A", "job/a", job("a").record),
        entry("A", "job_archive/x", JobArchive((), ())),
        entry("A", "outcome/r:2@a:fetch(10)::0/take(10)", DONE),
        entry("A", "outcome/r:2:fetch({what})::0/take({what})", DONE),
        entry("A", "outcome/r:0@a:::0/take(1)", DONE),
    ]
    for each in wrong:
        assert refusal_reason(each, MISSION, "r") is not None, each.name
    assert MISSION.tree.nodes[0].kind is Kind.JOBS
