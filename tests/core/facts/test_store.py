"""The fact map is a join semilattice, and its digest tells equal maps from different ones."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.store import (
    Change,
    Entry,
    FactMap,
    Incarnation,
    Version,
    join,
    parse_entry,
)

AUTHORS = ("A1", "B1")
SCOPE = "r1:0:a::0"

versions = st.builds(
    Version,
    st.builds(Incarnation, st.integers(0, 2), st.sampled_from(("m", "n"))),
    st.integers(1, 3),
)
claims = st.none() | st.builds(
    lambda phase, since: [SCOPE, "a", "a", phase, since, ""], st.integers(1, 3), st.integers(0, 2)
)
VALUES: dict[str, st.SearchStrategy[Any]] = {
    "claim": claims,
    "job_hold/j": st.builds(
        lambda how, who: [how, who, "", ""],
        st.sampled_from(("held", "now", "released")),
        st.sampled_from(("anna", "bert")),
    ),
    "job/j": st.builds(
        lambda priority, who: [["bring", [], priority, 0, 0, 0], who, "", ""],
        st.integers(0, 2),
        st.sampled_from(("anna", "bert")),
    ),
    f"outcome/{SCOPE}/a": st.builds(
        lambda ok, data: [ok, data], st.booleans(), st.none() | st.integers(0, 2)
    ),
    "condition/c": st.sampled_from(([True, 1, 0], [False, 2, 0], [True, 3, 1])),
    f"attempt/{SCOPE}": st.integers(0, 4),
    f"latched_failure/{SCOPE}": st.just(True),
}
names = st.sampled_from(sorted(VALUES))


def entries_named(name: str, authors: Iterable[str] = AUTHORS) -> st.SearchStrategy[Entry]:
    return st.builds(
        parse_entry, st.sampled_from(list(authors)), st.just(name), versions, VALUES[name]
    )


entries = names.flatmap(entries_named)
batches = st.lists(entries, max_size=12)


def fact_map(given_entries: Iterable[Entry] = ()) -> FactMap:
    facts = FactMap()
    facts.merge(given_entries)
    return facts


def content(facts: FactMap) -> list[tuple[str, str, Version, bytes]]:
    return [(e.author, e.name, e.version, e.packed) for e in facts]


def entry(value: Any, name: str, sequence: int = 1, life: int = 1, author: str = "A1") -> Entry:
    return parse_entry(author, name, Version(Incarnation(life, "n"), sequence), value)


def joined(first: Entry, second: Entry) -> Any:
    """The value that stands, whichever arrives first."""
    standing = join(first, second)
    assert standing == join(second, first)
    return standing.value


# -- the laws ---------------------------------------------------------------------------------


@given(batches, batches)
def test_joining_is_commutative(left: list[Entry], right: list[Entry]) -> None:
    assert content(fact_map(left + right)) == content(fact_map(right + left))


@given(batches, batches, batches)
def test_joining_is_associative(a: list[Entry], b: list[Entry], c: list[Entry]) -> None:
    b_and_c = list(fact_map(b + c))
    a_and_b = list(fact_map(a + b))
    assert content(fact_map(a + b_and_c)) == content(fact_map(a_and_b + c))


@given(batches)
def test_joining_is_idempotent(batch: list[Entry]) -> None:
    facts = fact_map(batch)
    before = content(facts), facts.digest()
    assert facts.merge(batch) == []
    assert facts.merge(list(facts)) == []
    assert (content(facts), facts.digest()) == before


@given(names.flatmap(lambda name: st.tuples(*[entries_named(name, ["A1"])] * 2)))
def test_two_entries_of_one_key_have_one_that_stands(pair: tuple[Entry, Entry]) -> None:
    first, second = pair
    assert join(first, second) in pair
    assert join(first, second) == join(second, first)


# -- what stands ------------------------------------------------------------------------------


def test_the_newest_version_stands_and_a_new_incarnation_is_newer_than_any_sequence() -> None:
    old, new = entry(None, "claim", 9), entry([SCOPE, "a", "a", 1, 0, ""], "claim", 1, life=2)
    assert joined(old, new) == new.value
    assert joined(entry(None, "claim", 2), entry([SCOPE, "a", "a", 1, 0, ""], "claim", 1)) is None


def test_equal_versions_are_ordered_by_their_bytes() -> None:
    one, other = (
        entry([SCOPE, "a", "a", 1, 0, ""], "claim"),
        entry([SCOPE, "a", "a", 2, 0, ""], "claim"),
    )
    assert joined(one, other) == max(one, other, key=lambda each: each.packed).value


def test_success_beats_failure_whichever_is_newer() -> None:
    name = f"outcome/{SCOPE}/a"
    assert joined(entry([True, None], name, 1), entry([False, None], name, 9))[0]
    assert joined(entry([False, None], name, 1), entry([True, None], name, 9))[0]


def test_of_equal_outcomes_the_first_stands() -> None:
    name = f"outcome/{SCOPE}/a"
    assert joined(entry([True, "first"], name, 1), entry([True, "second"], name, 2))[1] == "first"
    assert joined(entry([False, "old life"], name, 7), entry([False, "new"], name, 1, life=2))[
        1
    ] == ("old life")


def test_attempts_join_by_their_maximum() -> None:
    name = f"attempt/{SCOPE}"
    assert joined(entry(3, name, 1), entry(2, name, 5)) == 3


@pytest.mark.parametrize("kind", ["latched_failure", "expired"])
def test_a_latch_stays(kind: str) -> None:
    assert joined(entry(True, f"{kind}/{SCOPE}", 1), entry(True, f"{kind}/{SCOPE}", 2)) is True


def test_of_a_field_that_is_commanded_once_the_first_command_stands_of_others_the_newest() -> None:
    held, now = [["held", "op", "", ""], ["now", "op", "", ""]]
    assert joined(entry(held, "job_hold/j", 2), entry(now, "job_hold/j", 1)) == held
    one, two = ([["bring", [], n, 0, 0, 0], "op", "", ""] for n in (1, 2))
    assert joined(entry(one, "job/j", 2), entry(two, "job/j", 1)) == two


def test_authors_do_not_overwrite_one_another() -> None:
    facts = fact_map([entry(None, "claim", 9, author="A1"), entry(None, "claim", 1, author="B1")])
    assert [e.author for e in facts] == ["A1", "B1"]


# -- digests ----------------------------------------------------------------------------------


@given(batches, st.integers())
def test_the_digest_does_not_depend_on_the_order_of_arrival(batch: list[Entry], seed: int) -> None:
    shuffled = list(batch)
    random.Random(seed).shuffle(shuffled)
    assert fact_map(batch).digest() == fact_map(shuffled).digest()


@given(batches, batches)
@example([entry(None, "claim")], [entry(None, "claim", author="B1")])
@example([entry(True, f"latched_failure/{SCOPE}")], [entry(True, f"expired/{SCOPE}")])
@example([entry(1, f"attempt/{SCOPE}", 1)], [entry(1, f"attempt/{SCOPE}", 2)])
def test_digests_are_equal_exactly_where_the_maps_are(
    left: list[Entry], right: list[Entry]
) -> None:
    one, other = fact_map(left), fact_map(right)
    assert (one.digest() == other.digest()) == (content(one) == content(other))
    by_author = one.author_digests(), other.author_digests()
    for author in AUTHORS:
        same = content(fact_map(one.of_author(author))) == content(
            fact_map(other.of_author(author))
        )
        assert (by_author[0].get(author) == by_author[1].get(author)) == same


@given(batches, st.lists(st.integers(0, 11), max_size=6))
def test_the_digest_that_is_kept_up_to_date_equals_one_made_afresh(
    batch: list[Entry], dropped: list[int]
) -> None:
    facts = fact_map(batch)
    for position in dropped:
        if position < len(batch):
            facts.drop(batch[position].author, batch[position].name)
    fresh = fact_map(list(facts))
    assert facts.digest() == fresh.digest()
    assert facts.author_digests() == fresh.author_digests()


def test_an_author_whose_entries_are_all_dropped_is_in_no_digest() -> None:
    facts = fact_map([entry(None, "claim")])
    facts.drop("A1", "claim")
    assert facts.author_digests() == {}
    assert facts.digest() == fact_map().digest()


# -- telling what changed ---------------------------------------------------------------------


@given(batches)
def test_every_change_is_told_once_and_nothing_else_is(batch: list[Entry]) -> None:
    told: dict[tuple[str, str], Entry] = {}

    def note(changes: Sequence[Change]) -> None:
        for old, new in changes:
            assert new is not None
            assert old == told.get((new.author, new.name))
            assert old != new
            told[new.author, new.name] = new

    facts = FactMap()
    facts.subscribe(note)
    changed = facts.merge(batch)
    assert {(e.author, e.name): e for e in changed} == told
    assert list(facts) == [told[key] for key in sorted(told)]


def test_dropping_tells_what_is_gone_and_dropping_the_unknown_tells_nothing() -> None:
    told: list[tuple[Entry | None, Entry | None]] = []
    facts = FactMap()
    facts.subscribe(told.extend)
    gone = entry(None, "claim")
    facts.merge([gone])
    facts.drop("A1", "claim")
    facts.drop("A1", "claim")
    assert told == [(None, gone), (gone, None)]
    assert len(facts) == 0
    assert facts.get("A1", "claim") is None
