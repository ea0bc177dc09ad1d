"""ROS 2 in tests: real robots of rclpy, and a stand-in for the bridge where there is no ROS."""
