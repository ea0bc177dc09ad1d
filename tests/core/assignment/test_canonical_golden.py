"""The same canonical answers everywhere: held against a file that was made once.

On another version of Python, NumPy or OR-tools the test has to find the same.
"""

from __future__ import annotations

import json

import pytest

from tests.support.golden_assignments import FILE, SIZES, digests, name


@pytest.mark.parametrize("size", SIZES, ids=name)
def test_the_answers_are_those_of_the_file(size: tuple[int, int, int, bool]) -> None:
    expected = json.loads(FILE.read_text())[name(size)]
    assert digests(*size) == expected
    assert expected["feasible"] * 3 > size[2], "too few cases have an answer"
