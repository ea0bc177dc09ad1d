"""Data as messages may hold it, whole and with a wrong part, for property tests."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(1 << 63), (1 << 64) - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=8)
    | st.binary(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=12,
)


def mutations(value: Any) -> st.SearchStrategy[Any]:
    """`value` with one part, at any depth, replaced by something arbitrary."""
    if not isinstance(value, list) or not value:
        return plain
    inside = st.integers(0, len(value) - 1).flatmap(
        lambda i: mutations(value[i]).map(lambda part: [*value[:i], part, *value[i + 1 :]])
    )
    return inside | plain
