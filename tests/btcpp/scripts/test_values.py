"""Values and how one type becomes another."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.btcpp.scripts.values import (
    EXACT,
    ValueTypeError,
    as_integer,
    as_number,
    as_text,
    as_truth,
    copied_into,
    read_text,
)

# To Python's float() most of them are numbers.
NO_REALS = ("x", "", ".", "1_000", "+5", " 5", "5x", "0x1", "1e400", "1e-400", "１２", "1e", "1,5")


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("12", "int", 12),
        ("-12", "int64_t", -12),
        ("RED", "int", 1),
        ("2.5", "double", 2.5),
        ("TRUE", "bool", True),
        ("0", "bool", False),
        ("-.5e1", "double", -5.0),
        ("5. ", "float", 5.0),
        ("-Infinity", "double", -math.inf),
        ("0e400", "double", 0.0),
        ("1;2", "std::vector<double>", [1.0, 2.0]),
        ("1;2;", "list<int>", [1, 2]),
        ("1;2", "list<int>", [1, 2]),
        ("", "list<int>", []),
        ('json:{"x": 1}', "Pose", {"x": 1}),
        ("1;2", "geometry_msgs::Pose", "1;2"),
        ("json:x", "std::string", "json:x"),
    ],
)
def test_texts_are_read_as_the_type_that_is_needed(text: str, kind: str, value: Any) -> None:
    if kind == "std::string":
        with pytest.raises(ValueTypeError, match="not JSON"):
            read_text(text, kind)
        return
    found = read_text(text, kind, {"RED": 1})
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("x", "int", "'x' is not an integer"),
        ("2.5", "int", "'2.5' is not an integer"),
        ("-1", "unsigned int", "-1 is out of the range of unsigned int"),
        (str(2**31), "int", "out of the range of int"),
        ("9" * 50, "int", "is not an integer"),
        *((text, "double", "is not a real number") for text in NO_REALS),
        ("maybe", "bool", "neither true nor false"),
        ("1;x", "list<int>", "'x' is not an integer"),
    ],
)
def test_texts_that_cannot_be_read(text: str, kind: str, message: str) -> None:
    with pytest.raises(ValueTypeError, match=message):
        read_text(text, kind)


@given(st.integers(-(2**63), 2**63 - 1))
def test_integers_are_exact_or_refused(number: int) -> None:
    if abs(number) <= EXACT:
        assert as_integer(as_number(number)) == number
    else:
        with pytest.raises(ValueTypeError, match="too large"):
            as_number(number)
    assert as_integer(as_text(number)) == number


@given(st.floats(allow_nan=False) | st.integers(-(2**63), 2**63 - 1) | st.text(max_size=5))
def test_what_is_copied_into_an_entry_takes_its_type_or_is_refused(value: Any) -> None:
    for before in (1, 1.5, "x", True):
        try:
            after = copied_into(before, value)
        except ValueTypeError:
            continue
        assert type(after) is (int if isinstance(before, bool) else type(before))
        assert as_text(after) == as_text(value) or after == pytest.approx(value)
    assert copied_into(None, value) is value


@pytest.mark.parametrize("value", [2, -1, "true", None, -0.5])
def test_what_is_neither_true_nor_false(value: Any) -> None:
    with pytest.raises(ValueTypeError):
        as_truth(value)
