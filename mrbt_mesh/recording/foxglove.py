"""Messages in Foxglove's own schemas, drawn by its 3D panel: frames and the entities in them.

The schemas are published by Foxglove (`foxglove_schemas/`, with their licence). Messages have all
of the required fields, and no others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

WORLD = "world"
_ROBOT = "robot/"
LINE_STRIP, LINE_LOOP = 0, 1
MATCHING_ID = 0
SECOND_NS = 1_000_000_000
TEXT_PIXELS = 14
DIGITS = 6

Values: TypeAlias = "dict[str, Any]"

_SHAPES = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")


def robot_frame(robot: str) -> str:
    """Return the frame that moves with a robot; it never equals the world's frame."""
    return _ROBOT + robot


def robot_of(frame: str) -> str:
    """The inverse of `robot_frame`."""
    return frame.removeprefix(_ROBOT)


def timestamp(at_ns: int) -> Values:
    """Return a time, or a duration, given in nanoseconds."""
    return {"sec": at_ns // SECOND_NS, "nsec": at_ns % SECOND_NS}


def vector(x: float, y: float, z: float = 0.0) -> Values:
    """Return a position, or a size."""
    return {"x": float(x), "y": float(y), "z": float(z)}


def turned(heading: float) -> Values:
    """Return the quaternion of a turn about the z axis, in radians."""
    sine, cosine = math.sin(heading / 2), math.cos(heading / 2)
    # Headings have three decimals; with all digits, this would be a third of the text.
    return {"x": 0.0, "y": 0.0, "z": round(sine, DIGITS), "w": round(cosine, DIGITS)}


def heading_of(rotation: Mapping[str, float]) -> float:
    """The inverse of `turned`, up to rounding, for turns of at most half a circle."""
    return 2 * math.atan2(rotation["z"], rotation["w"])


def color(text: str) -> Values:
    """Return the colour `#rrggbb`."""
    red, green, blue = (int(text[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return {"r": red, "g": green, "b": blue, "a": 1.0}


def frame_transform(frame: str, x: float, y: float, heading: float, at_ns: int) -> Values:
    """Return a `foxglove.FrameTransform`: where a frame is in the world, from now on."""
    return {
        "timestamp": timestamp(at_ns),
        "parent_frame_id": WORLD,
        "child_frame_id": frame,
        "translation": vector(x, y),
        "rotation": turned(heading),
    }


def scene_update(entities: Sequence[Values], gone: Iterable[str], at_ns: int) -> Values:
    """Return a `foxglove.SceneUpdate` that adds entities and removes those with the ids `gone`."""
    at = timestamp(at_ns)
    deletions = [{"timestamp": at, "type": MATCHING_ID, "id": name} for name in gone]
    return {"deletions": deletions, "entities": list(entities)}


def entity(
    name: str, frame: str, about: Mapping[str, str], at_ns: int, **shapes: Sequence[Values]
) -> Values:
    """Return a `foxglove.SceneEntity`: it moves with its frame, until it is replaced or deleted."""
    return {
        "timestamp": timestamp(at_ns),
        "frame_id": frame,
        "id": name,
        "lifetime": timestamp(0),
        "frame_locked": True,
        "metadata": [{"key": key, "value": about[key]} for key in about],
        **{kind: list(shapes.get(kind, ())) for kind in _SHAPES},
    }


def _pose(x: float, y: float, z: float = 0.0) -> Values:
    return {"position": vector(x, y, z), "orientation": turned(0.0)}


def arrow(size: float, paint: Values) -> Values:
    """Return an arrow around the origin, along the x axis."""
    return {
        "pose": _pose(-0.8 * size, 0),
        "shaft_length": size,
        "shaft_diameter": 0.5 * size,
        "head_length": 0.8 * size,
        "head_diameter": 1.2 * size,
        "color": paint,
    }


def disc(x: float, y: float, radius: float, paint: Values) -> Values:
    """Return a flat cylinder around a point."""
    return {
        "pose": _pose(x, y),
        "size": vector(2 * radius, 2 * radius, 0.5 * radius),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": paint,
    }


def line(
    points: Iterable[Sequence[float]], is_closed: bool, width_pixels: float, paint: Values
) -> Values:
    """Return a line through points, of constant width on screen."""
    return {
        "type": LINE_LOOP if is_closed else LINE_STRIP,
        "pose": _pose(0, 0),
        "thickness": float(width_pixels),
        "scale_invariant": True,
        "points": [vector(x, y) for x, y in points],
        "color": paint,
        "colors": [],
        "indices": [],
    }


def label(x: float, y: float, z: float, text: str, paint: Values) -> Values:
    """Return a text that faces the viewer, of constant size on screen."""
    return {
        "pose": _pose(x, y, z),
        "billboard": True,
        "font_size": float(TEXT_PIXELS),
        "scale_invariant": True,
        "color": paint,
        "text": text,
    }
