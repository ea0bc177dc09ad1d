"""The bridge: a program beside a robot that speaks ROS 2, run by the Python that has rclpy.

It knows nothing about teams, and imports nothing from mrbt_mesh: it reads commands from standard
input and writes reports to standard output, both in msgpack.
"""
