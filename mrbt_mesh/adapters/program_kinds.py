"""The kinds of robots for which `mrbt new` writes a mission and a program; loads no adapter."""

from __future__ import annotations

from pathlib import Path

from mrbt_mesh.plugins import ProgramKind

_HERE = Path(__file__).parent

ROS2 = ProgramKind(
    "For robots of ROS 2, with virtual ones to try it.",
    _HERE / "ros2" / "template",
    "first, with ROS 2: python3 {folder}/virtual_robots.py A1 A2 A3",
)
VDA5050 = ProgramKind("Robots that are AGVs of VDA 5050.", _HERE / "vda5050" / "template")
