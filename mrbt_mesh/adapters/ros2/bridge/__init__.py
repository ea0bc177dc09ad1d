"""The program beside a robot that talks ROS 2; it runs under the Python that has rclpy.

It knows nothing of teams, and imports nothing of mrbt_mesh: commands come on its standard input,
and reports go to its standard output, in msgpack.
"""
