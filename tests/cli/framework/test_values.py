"""Numbers on the command line: what is taken, and what is expected instead."""

from __future__ import annotations

import click
import pytest

from mrbt_mesh.cli.framework.values import NumberBounds, NumberType, PathType, TextType


@pytest.mark.parametrize(
    ("bounds", "text", "number"),
    [
        (NumberBounds(), "-1.5", -1.5),
        (NumberBounds(least=0, most=1), "0", 0.0),
        (NumberBounds(least=0, most=1), "1", 1.0),
        (NumberBounds(above=0), "0.001", 0.001),
        (NumberBounds(least=0, most=1, step=0.001), "0.007", 0.007),
        (NumberBounds(least=0, step=0.001), "123456.789", 123456.789),
    ],
)
def test_a_number_within_its_bounds(bounds: NumberBounds, text: str, number: float) -> None:
    assert NumberType(float, bounds).convert(text, None, None) == number


@pytest.mark.parametrize(
    ("bounds", "text", "expected"),
    [
        (NumberBounds(), "x", "a number, at most 1000000000"),
        (NumberBounds(), "nan", "a number"),
        (NumberBounds(), "inf", "a number"),
        (NumberBounds(), "1e300", "a number, at most 1000000000"),
        (NumberBounds(least=0, most=1), "1.01", "a number, 0 to 1"),
        (NumberBounds(least=0, most=1), "-0.01", "a number, 0 to 1"),
        (NumberBounds(above=0), "0", "a number, above 0"),
        (NumberBounds(least=0.5), "0.4", "a number, 0.5 or more"),
        (NumberBounds(above=0, most=9), "10", "a number, above 0, at most 9"),
        (NumberBounds(least=0, most=1, step=0.001), "0.0004", "0 to 1, in steps of 0.001"),
    ],
)
def test_a_number_beyond_its_bounds(bounds: NumberBounds, text: str, expected: str) -> None:
    with pytest.raises(click.BadParameter) as caught:
        NumberType(float, bounds).convert(text, None, None)
    assert caught.value.message.startswith(f"{text}: expected ")
    assert expected in caught.value.message


def test_whole_numbers_may_be_as_large_as_they_like() -> None:
    kind = NumberType(int, NumberBounds(least=0))
    assert kind.convert("1234567890123", None, None) == 1234567890123
    for text in ("1.5", "", "-1", "9" * 5_000):
        with pytest.raises(click.BadParameter, match="expected a whole number, 0 or more"):
            kind.convert(text, None, None)


def test_texts_and_paths_have_something_in_them() -> None:
    assert TextType().convert("a b", None, None) == "a b"
    for kind in (TextType(), PathType()):
        for text in ("", "  "):
            with pytest.raises(click.BadParameter):
                kind.convert(text, None, None)
    with pytest.raises(click.BadParameter, match="is no path"):
        PathType().convert("a\0b", None, None)
    with pytest.raises(click.BadParameter, match="too long"):
        PathType().convert("a" * 300, None, None)
