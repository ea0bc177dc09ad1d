"""Names in the order in which people look for them."""

from __future__ import annotations

from mrbt_mesh.core.mission.names import name_order


def test_numbers_in_names_count_as_numbers() -> None:
    names = ["C10", "C2", "A", "C", "2b", "10b"]
    assert sorted(names, key=name_order) == ["A", "C", "C2", "C10", "2b", "10b"]
