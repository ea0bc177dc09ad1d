"""Mission files as tools write them."""

from __future__ import annotations

import pytest
from ruamel.yaml import YAML

from mrbt_mesh.formats.mission_writer import mission_text


def test_a_long_collection_has_a_line_for_each_of_its_parts() -> None:
    ports = {f"a_long_name_{number}": number for number in range(8)}
    data = {"short": {"a": [1, 2]}, "long": {"ports": ports, "list": list(ports)}}
    text = mission_text(data, "What it is.")
    assert text.startswith("# What it is.\n\nshort:\n  a: [1, 2]\n\nlong:\n")
    assert "    a_long_name_7: 7\n" in text
    assert "  - a_long_name_7\n" in text
    assert max(map(len, text.splitlines())) <= 100
    assert YAML(typ="safe").load(text) == data


@pytest.mark.parametrize("length", [60, 79, 85, 100, 120, 127, 128, 129, 300])
@pytest.mark.parametrize("words", ["$a_parameter, ", " a:b ", "a 'quoted' text "])
def test_a_long_key_is_valid_wherever_it_stands(length: int, words: str) -> None:
    key = f"call({words * length}"[: length - 1] + ")"
    nested = {"needs": {key: {"min": 1, "max": 1}}, "list": [{key: "x"}, {"Condition": key}]}
    data = {"tasks": {key: nested}, "types": {"a": {"b": {key: 1, "c": 2}}}}
    assert YAML(typ="safe").load(mission_text(data, "")) == data
