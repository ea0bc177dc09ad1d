"""The committed JSON Schema."""

import json
from typing import Any

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.formats.mission_model import SCHEMA_FILE, MissionModel, schema_text


def schema() -> dict[str, Any]:
    result: dict[str, Any] = json.loads(SCHEMA_FILE.read_text(encoding="utf-8"))
    return result


def test_the_committed_schema_is_fresh() -> None:
    hint = "write it anew with `python -m mrbt_mesh.formats.mission_model`"
    assert SCHEMA_FILE.read_text(encoding="utf-8") == schema_text(), hint


def test_the_schema_knows_every_section_and_no_other() -> None:
    assert set(schema()["properties"]) == set(MissionModel.known_keys())
    assert schema()["additionalProperties"] is False
    required = ["mission", "local_tasks", "robot_types", "robots", "tree"]
    assert schema()["required"] == required


def test_a_node_has_one_key_which_is_a_kind_of_node() -> None:
    node = schema()["$defs"]["NodeModel"]
    assert set(node["properties"]) == {str(kind) for kind in Kind}
    assert (node["minProperties"], node["maxProperties"]) == (1, 1)
    assert node["additionalProperties"] is False
    assert not any("default" in kind for kind in node["properties"].values())


def test_every_reference_in_the_schema_leads_somewhere() -> None:
    known = {f"#/$defs/{name}" for name in schema()["$defs"]}
    seen: set[str] = set()

    def walk(part: Any) -> None:
        if isinstance(part, dict):
            if isinstance(part.get("$ref"), str):
                seen.add(part["$ref"])
            for inner in part.values():
                walk(inner)
        elif isinstance(part, list):
            for inner in part:
                walk(inner)

    walk(schema())
    assert "#/$defs/NodeModel" in seen
    assert seen <= known


def test_tags_that_tell_alternatives_apart_do_not_show() -> None:
    assert '"<' not in SCHEMA_FILE.read_text(encoding="utf-8")
