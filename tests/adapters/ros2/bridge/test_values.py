"""Plain data to messages and back, on classes that describe themselves as those of ROS do.

tests/adapters/ros2/bridge/test_ros.py does it with real ones.
"""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.ros2.bridge.values import (
    UnfitError,
    check_field,
    fill,
    find_type,
    read_field,
    reason_of,
    stamp_now,
)
from tests.support.ros2.messages import BY_NAME, DriveAction, LookService, message

pytestmark = pytest.mark.usefixtures("messages")
FINITE = st.floats(-1e6, 1e6)


def pose(data: Any) -> Any:
    made = BY_NAME["test_robots/Pose"]()
    fill(made, data)
    return made


@given(FINITE, FINITE, st.text(max_size=8), st.lists(FINITE, max_size=5))
def test_what_is_filled_in_is_read_back(x: float, y: float, frame: str, far: list[float]) -> None:
    made = pose({"position": {"x": x, "y": y}, "header": {"frame_id": frame}})
    assert read_field(made, "position.x") == x
    assert read_field(made, "header.frame_id") == frame
    scan = BY_NAME["test_robots/Scan"]()
    fill(scan, {"ranges": far, "way": [{"x": x}, {"y": y}]})
    assert read_field(scan, "ranges") == far
    assert read_field(scan, "way[1].y") == y
    assert read_field(scan, "way[2].y") is None
    assert read_field(scan, "ranges[-1]") == (far[-1] if far else None)


@given(st.floats(-3.1, 3.1))
def test_a_heading_for_a_quaternion(yaw: float) -> None:
    made = pose({"orientation": {"yaw": yaw}}).orientation
    assert 2 * math.atan2(made.z, made.w) == pytest.approx(yaw)


def test_arguments_of_tasks_are_texts() -> None:
    scan = BY_NAME["test_robots/Scan"]()
    given_data = {"count": "7", "level": "-3", "is_on": "true", "name": 4, "raw": 255}
    fill(scan, given_data | {"corners": [{"x": "1.5"}, {}]})
    assert (scan.count, scan.level, scan.is_on, scan.name) == (7, -3, True, "4")
    assert scan.raw == b"\xff"
    assert read_field(scan, "raw") == 255
    assert scan.corners[0].x == 1.5


def test_what_is_known_later_is_let_through() -> None:
    made = BY_NAME["test_robots/Pose"]()
    fill(made, {"position": {"x": "$x"}, "header": "$header"}, has_open=True)
    assert made.position.x == 0.0
    scan = BY_NAME["test_robots/Scan"]()
    fill(scan, {"ranges": ["$near", 2.0], "count": "$n"}, has_open=True)


def test_when_all_is_known_a_dollar_sign_is_one() -> None:
    assert pose({"header": {"frame_id": "cost $5"}}).header.frame_id == "cost $5"
    with pytest.raises(UnfitError, match=r"position.x: a number is expected, not '\$x'"):
        pose({"position": {"x": "$x"}})


def test_now_is_the_time_of_the_message() -> None:
    now = BY_NAME["builtin_interfaces/Time"]()
    now.sec = 17
    data = {"header": {"stamp": "now", "frame_id": "map"}}
    made = pose(data)
    stamp_now(made, data, now)
    assert made.header.stamp.sec == 17


@pytest.mark.parametrize(
    ("data", "said", "path"),
    [
        ({"positon": {}}, "positon: there is no field 'positon'; did you mean", ["positon"]),
        ({"position": {"z": 1}}, "position.z: there is no field 'z'; known: x, y", None),
        ({"position": 3}, "position: fields are expected (x, y), not 3", ["position"]),
        ({"position": {"x": "far"}}, "position.x: a number is expected, not 'far'", None),
        ({"position": {"x": True}}, "position.x: a number is expected, not True", None),
        (
            {"orientation": {"yaw": 1, "z": 1}},
            "orientation.yaw: give yaw or the quaternion, not both: z",
            None,
        ),
        ({"header": {"frame_id": True}}, "text is expected, not True", ["header", "frame_id"]),
    ],
)
def test_what_does_not_fit_a_pose(data: Any, said: str, path: Any) -> None:
    with pytest.raises(UnfitError) as error:
        pose(data)
    assert said in str(error.value)
    assert path is None or error.value.path == path


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"count": 256}, "count: a whole number from 0 to 255 is expected"),
        ({"count": 1.5}, "a whole number from 0 to 255 is expected"),
        ({"level": -40000}, "a whole number from -32768 to 32767 is expected"),
        ({"ranges": 3}, "ranges: a list is expected (sequence<double>), not 3"),
        ({"corners": [{}]}, "corners: 2 values are expected, not 1"),
        ({"way": [{}, {"z": 1}]}, "way[1].z: there is no field 'z'"),
        ({"is_on": "maybe"}, "is_on: true or false is expected, not 'maybe'"),
    ],
)
def test_what_does_not_fit_a_scan(data: Any, said: str) -> None:
    with pytest.raises(UnfitError) as error:
        fill(BY_NAME["test_robots/Scan"](), data)
    assert said in str(error.value)


def test_what_a_message_refuses_itself() -> None:
    class Strict(BY_NAME["test_robots/Point"]):  # type: ignore[misc]
        def __setattr__(self, name: str, value: Any) -> None:
            assert abs(value) < 10, "too far"
            super().__setattr__(name, value)

    with pytest.raises(UnfitError, match="x: too far"):
        fill(Strict(), {"x": 11})


def test_types_by_name() -> None:
    assert find_type("test_robots/action/Drive", "action") is DriveAction
    assert find_type("test_robots/srv/Look", "srv") is LookService


@pytest.mark.parametrize(
    ("name", "kind", "said"),
    [
        ("test_robots/action/Driv", "action", "test_robots has no action Driv; did you mean"),
        ("test_robots/msg/Pose", "srv", "a type with /srv/ is expected"),
        ("no_such_msgs/msg/Pose", "msg", "this Python has no no_such_msgs.msg; source"),
    ],
)
def test_types_that_are_not_there(name: str, kind: str, said: str) -> None:
    with pytest.raises(UnfitError) as error:
        find_type(name, kind)
    assert said in str(error.value)


@pytest.mark.parametrize(
    "path", ["ranges", "ranges[0]", "way[0].x", "corners[-1].y", "raw", "name", "is_on"]
)
def test_fields_that_are_there(path: str) -> None:
    check_field(BY_NAME["test_robots/Scan"], path)


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("rangs", "m.rangs: there is no field 'rangs'; did you mean 'ranges'?"),
        ("ranges.x", "ranges is of type sequence<double>: no fields"),
        ("count[0]", "count is of type uint8: no list"),
        ("way[0]", "is a message; name one of its fields (x, y)"),
        ("way", "is a list of messages; name a field of one"),
        ("way[0].z", "there is no field 'z'; known: x, y"),
    ],
)
def test_fields_that_are_not(path: str, said: str) -> None:
    with pytest.raises(UnfitError) as error:
        check_field(BY_NAME["test_robots/Scan"], path)
    assert said in str(error.value)


def test_what_results_say_of_failures() -> None:
    result = DriveAction.Result()
    assert reason_of(result) == ""
    result.error_code, result.error_msg = 203, "no path"
    assert reason_of(result) == "no path, error code 203"
    nested = message("Code", val="int32")()
    nested.val = -4
    result.error_code = nested
    assert reason_of(result) == "no path, error code -4"
    answer = LookService.Response()
    answer.message = "nothing there"
    assert reason_of(answer) == "nothing there"
