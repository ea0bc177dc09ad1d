"""Whoever falls behind is told the newest of each item, and nothing twice."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.views.model import changes
from mrbt_mesh.views.model.changes import ChangeLog

KEYS = st.sampled_from("abcd")
STEPS = st.lists(st.tuples(KEYS, st.one_of(st.none(), st.integers(0, 3))), max_size=40)


def test_only_the_newest_of_an_item_is_told() -> None:
    log = ChangeLog()
    for value in (1, 2, 3):
        log.put("a", value)
    log.put("b", [1])
    assert log.since(0) == {"a": 3, "b": [1]}
    assert log.since(3) == {"b": [1]}
    assert log.since(4) == {}


def test_what_is_the_same_is_no_change() -> None:
    log = ChangeLog()
    assert log.put("a", {"x": 1})
    assert not log.put("a", {"x": 1})
    assert not log.put("b", None)
    assert log.version == 1


def test_what_is_gone_is_told_to_those_who_knew_it() -> None:
    log = ChangeLog()
    log.put("a", 1)
    log.put("a", None)
    assert log.since(1) == {"a": None}
    assert log.since(0) == {}


def test_removals_of_long_ago_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(changes, "MOST_REMOVED", 2)
    log = ChangeLog()
    log.put("stays", 1)
    for number in range(100):
        log.put(f"job/{number}", number)
        log.put(f"job/{number}", None)
    assert len(log._items) == 3
    assert [log.start_of(version) for version in (log.version - 4, log.version - 5)] == [197, 0]
    assert log.since(197) == {"job/98": None, "job/99": None}


@given(STEPS, st.lists(st.integers(0, 39), max_size=10), st.integers(0, 3))
def test_a_page_that_asks_at_any_moments_has_what_there_is(
    steps: list[tuple[str, int | None]], moments: list[int], most_removed: int
) -> None:
    """Applying what came since, whenever one asks, gives what a dictionary holds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(changes, "MOST_REMOVED", most_removed)
        _ask_at(steps, moments)


def _ask_at(steps: list[tuple[str, int | None]], moments: list[int]) -> None:
    log, expected = ChangeLog(), dict[str, int]()
    page, seen = dict[str, int](), 0
    for number, (key, value) in enumerate([*steps, ("a", 9)]):
        log.put(key, value)
        expected.pop(key, None)
        if value is not None:
            expected[key] = value
        if number in moments or number == len(steps):
            start = log.start_of(seen)
            page = page if start else {}
            for changed, newest in log.since(start).items():
                page.pop(changed, None)
                if newest is not None:
                    page[changed] = newest
            seen = log.version
            assert page == expected
