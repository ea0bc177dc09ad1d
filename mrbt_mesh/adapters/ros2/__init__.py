"""ROS 2 robots: makes a robot program from a binding file.

    from mrbt_mesh.adapters.ros2 import robot_program

    robot = robot_program("ros2.yaml")     # next to this file, or an absolute path

Local tasks become actions, services and topics; conditions come from topics. rclpy runs in a
process of its own, with its own Python. docs/how-to/ros2.md describes the file.
"""

from mrbt_mesh.adapters.ros2.program import robot_program

__all__ = ["robot_program"]
