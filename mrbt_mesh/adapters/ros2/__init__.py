"""Robots of ROS 2: a robot program that is made of a binding file.

    from mrbt_mesh.adapters.ros2 import robot_program

    robot = robot_program("ros2.yaml")     # next to this file, or an absolute path

Local tasks become actions, services and topics; conditions come from topics. rclpy is in a process
of its own, under a Python of its own. docs/how-to/ros2.md has the form of the file.
"""

from mrbt_mesh.adapters.ros2.program import robot_program

__all__ = ["robot_program"]
