"""What a robot of this team can do: the actions, services and topics of ros2.yaml."""

from pathlib import Path

from mrbt_mesh.adapters.ros2 import robot_program

robot = robot_program(Path(__file__).with_name("ros2.yaml"), record_work=True)
