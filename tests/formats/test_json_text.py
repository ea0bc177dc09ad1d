"""JSON of others."""

from __future__ import annotations

import json

import pytest

from mrbt_mesh.formats.json_text import bounded_whole, without_doubles


def test_a_name_that_is_given_twice_is_refused_at_any_depth() -> None:
    with pytest.raises(ValueError, match="'b' is given twice"):
        json.loads('{"a": [{"b": 1, "c": 2, "b": 3}]}', object_pairs_hook=without_doubles)
    text = '{"a": {"a": 1}, "b": {}}'
    assert json.loads(text, object_pairs_hook=without_doubles) == json.loads(text)


def test_a_number_that_is_far_too_long_is_refused_before_it_is_read() -> None:
    with pytest.raises(ValueError, match="a number of 5000 digits"):
        json.loads("1" * 5000, parse_int=bounded_whole)
    assert json.loads("-17", parse_int=bounded_whole) == -17
