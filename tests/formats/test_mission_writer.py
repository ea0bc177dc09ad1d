"""Mission files as tools write them."""

from __future__ import annotations

from ruamel.yaml import YAML

from mrbt_mesh.formats.mission_writer import WIDTH, mission_text


def test_a_long_collection_has_a_line_for_each_of_its_parts() -> None:
    ports = {f"a_long_name_{number}": number for number in range(8)}
    data = {"short": {"a": [1, 2]}, "long": {"ports": ports, "list": list(ports)}}
    text = mission_text(data, "What it is.")
    assert text.startswith("# What it is.\n\nshort:\n  a: [1, 2]\n\nlong:\n")
    assert "    a_long_name_7: 7\n" in text
    assert "  - a_long_name_7\n" in text
    assert max(map(len, text.splitlines())) <= WIDTH
    assert YAML(typ="safe").load(text) == data
