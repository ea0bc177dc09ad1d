"""Compiled missions: whatever a mission says is read again, and whatever is damaged is refused."""

from __future__ import annotations

import json
from dataclasses import fields
from functools import cache
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.errors import FileError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.chaos.generate import generate_mission
from tests.support.paths import EXAMPLES

FILES = sorted(EXAMPLES.glob("**/mission.yaml"))


@cache
def generated(seed: int) -> Mission:
    return generate_mission(seed).mission


def assert_is_read_again(mission: Mission) -> None:
    text = compile_mission(mission)
    again = mission_from_compiled(text, "m.json")
    for field in fields(Mission):
        assert getattr(again, field.name) == getattr(mission, field.name)
    assert list(again.global_tasks) == list(mission.global_tasks)
    assert compile_mission(again) == text
    assert again.digest == mission.digest


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.parent.name)
def test_examples_are_read_again_field_by_field(file: Any) -> None:
    assert_is_read_again(load_mission(file))


@given(st.integers(0, 400))
def test_missions_with_all_features_are_read_again(seed: int) -> None:
    assert_is_read_again(generated(seed))


ANYTHING = st.sampled_from(
    [None, True, 0, 1, -1, 10**20, 1.0, "", "x", "x(1)", "id", [], [1], [[]], {}, {"x": 1}]
)


@given(st.data(), st.integers(0, 60), ANYTHING)
def test_damage_is_refused_or_a_mission(data: st.DataObject, seed: int, value: object) -> None:
    """Put anything at any place, take it away, or add something."""
    place: Any = json.loads(compile_mission(generated(seed)))
    compiled = place
    key: Any = data.draw(st.sampled_from(sorted(place)))
    while isinstance(place[key], dict | list) and place[key] and data.draw(st.integers(0, 4)):
        place = place[key]
        key = data.draw(
            st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place)))
        )
    how = data.draw(st.sampled_from(["put", "take", "add"]))
    if how == "take":
        del place[key]
    elif how == "add" and isinstance(place, dict):
        place[f"{key}_"] = value
    else:
        place[key] = value
    try:
        mission = mission_from_compiled(json.dumps(compiled), "m.json")
    except FileError:
        return
    assert_is_read_again(mission)
