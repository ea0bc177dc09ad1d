"""Names of C++ types in models."""

from __future__ import annotations

import pytest

from mrbt_mesh.btcpp.scripts.cpp_types import canonical_type, is_one_type


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("int32_t", "int"),
        ("unsigned", "unsigned int"),
        ("long", "int64_t"),
        ("uint16", "uint16_t"),
        ("string", "std::string"),
        (
            "std::__cxx11::basic_string<char, std::char_traits<char>, std::allocator<char> >",
            "std::string",
        ),
        ("std::vector<double, std::allocator<double> >", "std::vector<double>"),
        ("vector<string>", "std::vector<std::string>"),
        ("nav_msgs::msg::Path_<std::allocator<void> >", "nav_msgs::Path"),
        ("nav_msgs/msg/Path", "nav_msgs::Path"),
        ("NodeStatus", "BT::NodeStatus"),
        ("BT::AnyTypeAllowed", ""),
    ],
)
def test_one_name_for_each_type(name: str, expected: str) -> None:
    assert canonical_type(name) == expected


def test_a_list_of_messages_as_the_compiler_names_it() -> None:
    message = "geometry_msgs::msg::Pose_<std::allocator<void> >"
    name = f"std::vector<{message}, std::allocator<{message} > >"
    assert canonical_type(name) == "std::vector<geometry_msgs::Pose>"


def test_a_name_without_its_namespace_may_be_the_same_type() -> None:
    assert is_one_type("Path", "nav_msgs::Path")
    assert not is_one_type("nav_msgs::Path", "nav_msgs::OccupancyPath")
    assert not is_one_type("int", "unsigned int")
