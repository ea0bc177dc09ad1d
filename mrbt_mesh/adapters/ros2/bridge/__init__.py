"""The program beside a robot that talks ROS 2; it runs under whatever Python has rclpy.

It knows nothing of teams, and imports nothing of mrbt_mesh: it is told over its standard input
what to bind, start and cancel, and says on its standard output what came of it, in msgpack.
"""
