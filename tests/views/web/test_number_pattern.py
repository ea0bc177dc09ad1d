"""Texts of numbers of a range."""

from __future__ import annotations

import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from mrbt_mesh.core.mission.mission import MAX_NUMBER, is_whole_number
from mrbt_mesh.views.web.number_pattern import range_pattern

NUMBERS = st.integers(-120, 1_200) | st.integers(-MAX_NUMBER, MAX_NUMBER)


@given(st.tuples(NUMBERS, NUMBERS).map(sorted), st.data())
def test_it_matches_the_numbers_of_the_range_and_no_others(
    ends: list[int], data: st.DataObject
) -> None:
    low, high = ends
    pattern = re.compile(range_pattern(low, high))
    near = [each + more for each in ends for more in (-1, 0, 1)]
    drawn = data.draw(st.lists(NUMBERS | st.integers(low, high), max_size=9))
    for number in {*near, *drawn, -low, 0}:
        assert bool(pattern.fullmatch(str(number))) is (low <= number <= high), number


@given(st.integers(-30, 130), st.integers(0, 130))
@example(0, 0)
@example(-30, 130)
def test_all_numbers_of_small_ranges(low: int, width: int) -> None:
    pattern = re.compile(range_pattern(low, low + width))
    found = [n for n in range(-400, 400) if pattern.fullmatch(str(n))]
    assert found == list(range(low, low + width + 1))


@given(st.text("0123456789-+. ", max_size=4))
def test_other_texts_of_digits_are_none(text: str) -> None:
    is_matched = re.fullmatch(range_pattern(-MAX_NUMBER, MAX_NUMBER), text) is not None
    assert is_matched is is_whole_number(text)


def test_an_empty_range_is_refused() -> None:
    with pytest.raises(ValueError, match="no number is from 2 to 1"):
        range_pattern(2, 1)
