"""The project's own check of messages, held against a full validator of JSON Schema."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import jsonschema
import pytest

from mrbt_mesh.recording.channels import CHANNELS, Channel
from mrbt_mesh.recording.schema_check import compile_schema

# In the place of each value of a message.
OTHERS: tuple[Any, ...] = (None, True, False, 0, 1, 2, -1, 1.0, 0.5, 10**9, "", "R", "00")
OTHERS += ("0" * 32, [], [0], [None], ["00"], {}, {"id": 0}, {"A1": "00"})


def changed(value: Any) -> Iterator[Any]:
    """The value with another one in the place of one of its parts, without one, with one more."""
    yield from OTHERS
    if isinstance(value, dict):
        yield {**value, "more": 1}
        for name, item in value.items():
            yield {other: value[other] for other in value if other != name}
            for each in changed(item):
                yield {**value, name: each}
    elif isinstance(value, list):
        yield [*value, *value]
        for number, item in enumerate(value[:2]):
            for each in changed(item):
                yield [*value[:number], each, *value[number + 1 :]]


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=CHANNELS)
def test_it_judges_every_change_of_an_example_as_a_full_validator_does(channel: Channel) -> None:
    schema = copy.deepcopy(dict(channel.schema))
    check, full = compile_schema(schema), jsonschema.Draft202012Validator(schema)
    example = {**channel.example, "check": "0011223344556677"}
    check(example)
    verdicts = set()
    for value in changed(example):
        fits = full.is_valid(value)
        verdicts.add(fits)
        if fits:
            check(value)
        else:
            with pytest.raises(ValueError, match="must"):
                check(value)
    assert False in verdicts


def test_it_says_where_and_what() -> None:
    schema = {"type": "object", "properties": {"a": {"type": "array", "items": {"minimum": 1}}}}
    with pytest.raises(ValueError, match=r"^data\.a\[1\] must be at least 1$"):
        compile_schema(schema)({"a": [1, 0]})


def test_the_end_of_a_pattern_is_the_end_of_the_text() -> None:
    check = compile_schema({"type": "string", "pattern": "^([0-9a-f]{2})*$"})
    check("00ff")
    with pytest.raises(ValueError, match="must match"):
        check("00\n")


def test_a_keyword_that_it_does_not_know_is_refused() -> None:
    with pytest.raises(ValueError, match="no check for maxLength"):
        compile_schema({"type": "string", "maxLength": 3})
