"""The schemas of rmf_api_msgs, judged by another library than the product's."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from referencing import Registry, Resource

from mrbt_mesh.adapters.rmf.requests import SCHEMAS

ALL: dict[str, dict[str, Any]] = {
    path.stem: json.loads(path.read_text(encoding="utf-8")) for path in SCHEMAS.glob("*.json")
}
_TEXT = st.text(max_size=8)
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | _TEXT,
    lambda part: st.lists(part, max_size=3) | st.dictionaries(_TEXT, part, max_size=3),
    max_leaves=5,
)
# Two files have one `$id`; nothing refers to it.
_REGISTRY: Registry[Any] = Registry().with_resources(
    (schema["$id"], Resource.from_contents(schema)) for schema in ALL.values()
)


@cache
def validator(name: str) -> Draft202012Validator:
    """Judges messages by the schema of this name."""
    return Draft202012Validator(ALL[name], registry=_REGISTRY)


def response_to(kind: Any) -> str:
    """The name of the schema of responses to requests of this type."""
    if kind == "activitiy_discovery_request":  # as its schema has it
        kind = "activity_discovery_request"
    name = kind.replace("_request", "_response") if isinstance(kind, str) else ""
    return name if kind in ALL and name in ALL else "simple_response"


def messages(schema: Any) -> st.SearchStrategy[Any]:
    """Values that fit a schema of these files, as far as its keywords `type`, `properties`,
    `required`, `items` and `enum` say; each part may be something else with a small chance.
    """
    if str(schema.get("$ref", "")).endswith(".json"):
        return messages(ALL[schema["$ref"].removesuffix(".json")])
    if "enum" in schema:
        return st.sampled_from(schema["enum"])
    match schema.get("type"):
        case "object":
            needed = set(schema.get("required", ()))
            parts = {name: messages(part) for name, part in schema.get("properties", {}).items()}
            return st.fixed_dictionaries(
                {name: part for name, part in parts.items() if name in needed},
                optional={name: part for name, part in parts.items() if name not in needed}
                | {"else": ANYTHING},
            )
        case "array":
            return st.lists(messages(schema.get("items", {})), max_size=3)
        case "string":
            return st.text(max_size=20)
        case "integer":
            return st.integers()
    return ANYTHING


def perhaps_wrong(value: Any) -> st.SearchStrategy[Any]:
    """A message, also with one of its parts left out or replaced."""
    if not isinstance(value, dict) or not value:
        return st.just(value) | ANYTHING
    keys = st.sampled_from(sorted(value))
    without = keys.map(lambda key: {name: each for name, each in value.items() if name != key})
    other = st.tuples(keys, ANYTHING).map(lambda pair: value | {pair[0]: pair[1]})
    inner = keys.flatmap(
        lambda key: perhaps_wrong(value[key]).map(lambda each: value | {key: each})
    )
    return st.just(value) | without | other | inner
