"""Foxglove's schemas are as they were published, and what is made here fits them."""

from __future__ import annotations

import hashlib
import json
import math
from typing import Any

import fastjsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.recording import foxglove
from mrbt_mesh.recording.channels import CHANNELS, POSITIONS, SCENE, SCHEMAS
from mrbt_mesh.recording.foxglove import heading_of, turned

NUMBERS = st.floats(-1e6, 1e6)
FITS_FRAME = fastjsonschema.compile(dict(CHANNELS[POSITIONS].schema))
FITS_SCENE = fastjsonschema.compile(dict(CHANNELS[SCENE].schema))
TEXTS = st.text(max_size=8)


def sums() -> dict[str, str]:
    rows = (SCHEMAS / "SHA256SUMS").read_text().splitlines()
    return {name: digest for digest, name in (row.split() for row in rows)}


def test_what_was_published_is_unchanged() -> None:
    assert {path.name for path in SCHEMAS.iterdir()} - {"SHA256SUMS"} == set(sums())
    for name, digest in sums().items():
        assert hashlib.sha256((SCHEMAS / name).read_bytes()).hexdigest() == digest, name
    licence = (SCHEMAS / "LICENSE").read_text()
    assert all(path.name in licence for path in SCHEMAS.glob("*.json"))


@given(st.integers(-3_142, 3_142))
def test_a_heading_comes_back(milliradians: int) -> None:
    rotation = turned(milliradians / 1_000)
    assert round(heading_of(rotation) * 1_000) == milliradians
    assert math.isclose(sum(value**2 for value in rotation.values()), 1.0, abs_tol=1e-5)


def test_a_turn_to_the_left_is_about_the_z_axis() -> None:
    """The example in the schema's own description: 90 degrees."""
    assert "x=0, y=0, z=0.707, w=0.707" in dict(CHANNELS[POSITIONS].schema)["description"]
    rounded = {axis: round(value, 3) for axis, value in turned(math.pi / 2).items()}
    assert rounded == {"x": 0, "y": 0, "z": 0.707, "w": 0.707}


@given(TEXTS, NUMBERS, NUMBERS, st.floats(-4, 4), st.integers(0, 1 << 62))
def test_a_frame_fits_the_schema(
    robot: str, x: float, y: float, heading: float, at_ns: int
) -> None:
    frame = foxglove.robot_frame(robot)
    made = foxglove.frame_transform(frame, x, y, heading, at_ns)
    FITS_FRAME(json.loads(json.dumps(made)))
    at = made["timestamp"]
    assert at["sec"] * 1_000_000_000 + at["nsec"] == at_ns
    assert foxglove.robot_of(frame) == robot
    assert frame != foxglove.WORLD


RED = foxglove.color("#ff0000")
SHAPES: dict[str, list[dict[str, Any]]] = {
    "arrows": [foxglove.arrow(2, RED)],
    "cylinders": [foxglove.disc(1, 2, 3, RED)],
    "lines": [
        foxglove.line([(0, 0), (1, 1)], True, 3, RED),
        foxglove.line([(0, 0), (1, 1)], False, 3, RED),
    ],
    "texts": [foxglove.label(1, 2, 3, "A", RED)],
}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_fits_the_schema_and_no_field_can_be_spared(kind: str) -> None:
    for shape in SHAPES[kind]:
        for spared in (None, *shape):
            drawn = {key: value for key, value in shape.items() if key != spared}
            entity = foxglove.entity("A", foxglove.WORLD, {"a": "b"}, 7, **{kind: [drawn]})
            made = foxglove.scene_update([entity], ["B"], 7)
            if spared is None:
                FITS_SCENE(made)
            else:
                with pytest.raises(fastjsonschema.JsonSchemaValueException, match=spared):
                    FITS_SCENE(made)


def test_colours_are_from_0_to_1() -> None:
    assert foxglove.color("#ff0033") == {"r": 1.0, "g": 0.0, "b": 0.2, "a": 1.0}
