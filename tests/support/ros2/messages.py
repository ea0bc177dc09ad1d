"""Message classes that say what they are made of, as those do that ROS generates."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import ModuleType
from typing import Any, ClassVar

DEFAULTS: dict[str, Any] = {"boolean": False, "string": "", "double": 0.0, "float": 0.0}


class Message:
    """A message with these fields; `FIELDS` are names and types as ROS writes them."""

    FIELDS: ClassVar[Mapping[str, str]] = {}

    def __init__(self) -> None:
        for name, kind in self.FIELDS.items():
            setattr(self, name, _default(kind))

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """As in ROS."""
        return dict(cls.FIELDS)


def _default(kind: str) -> Any:
    if kind.startswith("sequence<"):
        return []
    if kind.endswith("]"):
        inner, _, count = kind[:-1].partition("[")
        return [_default(inner) for _ in range(int(count))]
    if "/" in kind:
        return BY_NAME[kind]()
    return DEFAULTS.get(kind, 0)


def message(class_name: str, /, **fields: str) -> type[Message]:
    """A class of messages."""
    return type(class_name, (Message,), {"FIELDS": fields})


BY_NAME: dict[str, type[Message]] = {}
BY_NAME["builtin_interfaces/Time"] = message("Time", sec="int32", nanosec="uint32")
BY_NAME["test_robots/Point"] = message("Point", x="double", y="double")
BY_NAME["test_robots/Quaternion"] = message(
    "Quaternion", x="double", y="double", z="double", w="double"
)
BY_NAME["test_robots/Header"] = message(
    "Header", stamp="builtin_interfaces/Time", frame_id="string"
)
BY_NAME["test_robots/Pose"] = message(
    "Pose",
    header="test_robots/Header",
    position="test_robots/Point",
    orientation="test_robots/Quaternion",
)
BY_NAME["test_robots/Scan"] = message(
    "Scan",
    ranges="sequence<double>",
    small="sequence<int8, 3>",
    corners="test_robots/Point[2]",
    way="sequence<test_robots/Point>",
    raw="octet",
    count="uint8",
    level="int16",
    is_on="boolean",
    name="string<10>",
)


class DriveAction:
    """An action."""

    Goal = message("Drive_Goal", pose="test_robots/Pose", speed="float")
    Result = message("Drive_Result", error_code="uint16", error_msg="string", way="double")
    Feedback = message("Drive_Feedback", left="double", place="test_robots/Point")


class LookService:
    """A service."""

    Request = message("Look_Request", name="string")
    Response = message("Look_Response", success="boolean", message="string")


@contextmanager
def installed() -> Iterator[None]:
    """With the packages of these messages, as if this Python had them."""
    modules: dict[str, ModuleType] = {}
    for package in ("test_robots", "builtin_interfaces"):
        modules[package] = ModuleType(package)
        for kind in ("msg", "action", "srv"):
            modules[f"{package}.{kind}"] = ModuleType(f"{package}.{kind}")
    for full_name, found in BY_NAME.items():
        package, _, name = full_name.partition("/")
        setattr(modules[f"{package}.msg"], name, found)
    modules["test_robots.action"].Drive = DriveAction  # type: ignore[attr-defined]
    modules["test_robots.srv"].Look = LookService  # type: ignore[attr-defined]
    sys.modules.update(modules)
    try:
        yield
    finally:
        for name in modules:
            del sys.modules[name]
