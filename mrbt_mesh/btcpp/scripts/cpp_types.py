"""Names of C++ types. Models contain names written by compilers, by editors and by hand.

`std::string`, `string` and `std::__cxx11::basic_string<char, ...>` are the same type. So are the
C++ name of a ROS message (`nav_msgs::msg::Path_<std::allocator<void> >`) and its ROS name
(`nav_msgs/Path`).
"""

from __future__ import annotations

import re
from functools import lru_cache

from mrbt_mesh.btcpp.scripts.values import ANY_TYPE

_MESSAGE_ALLOCATOR = re.compile(r"_<std::allocator<void> ?>")
_ALLOCATOR = re.compile(r", ?std::allocator<(?:[^<>]|<[^<>]*>)*>")
_LIST = re.compile(r"(?:vector|deque|list)<(.+)>")
# The canonical name of each known type, by its other names after normalisation.
_NAMES = {
    **dict.fromkeys(("int", "int32_t", "int32", "signed int", "integer"), "int"),
    **dict.fromkeys(("unsigned int", "unsigned", "uint32_t", "uint32"), "unsigned int"),
    **dict.fromkeys(("int64_t", "int64", "long", "long int", "long long"), "int64_t"),
    **dict.fromkeys(
        (
            "uint64_t",
            "uint64",
            "unsigned long",
            "unsigned long int",
            "unsigned long long",
            "size_t",
        ),
        "uint64_t",
    ),
    **dict.fromkeys(("int16_t", "int16", "short"), "int16_t"),
    **dict.fromkeys(("uint16_t", "uint16", "unsigned short"), "uint16_t"),
    **dict.fromkeys(("int8_t", "int8", "signed char"), "int8_t"),
    **dict.fromkeys(("uint8_t", "uint8", "unsigned char"), "uint8_t"),
    **dict.fromkeys(("float", "float32"), "float"),
    **dict.fromkeys(("double", "float64"), "double"),
    **dict.fromkeys(("bool", "boolean"), "bool"),
    **dict.fromkeys(("string", "basic_string<char,char_traits<char>>"), "std::string"),
    "NodeStatus": "BT::NodeStatus",
    "Any": ANY_TYPE,
    "AnyTypeAllowed": "",
}


@lru_cache(maxsize=1024)
def canonical_type(name: str) -> str:
    """Return the canonical name of a type; "" for a type that allows anything."""
    text = _MESSAGE_ALLOCATOR.sub("", name.replace("__cxx11::", ""))
    text = re.sub(r" ?([<>,]) ?", r"\1", _ALLOCATOR.sub("", " ".join(text.split())))
    text = re.sub(r"\b(?:std|BT|msg)::", "", text.replace("/", "::"))
    if match := _LIST.fullmatch(text):
        return f"std::vector<{canonical_type(match[1])}>"
    return _NAMES.get(text, text)


def is_one_type(name: str, other: str) -> bool:
    """Return whether two canonical names may mean the same type; one may lack the namespace."""
    return name == other or name.endswith(f"::{other}") or other.endswith(f"::{name}")
