"""Every robot of the team is a vehicle of agvs.yaml: there is nothing else to program."""

from pathlib import Path

from mrbt_mesh.adapters.vda5050 import robot_program

robot = robot_program(Path(__file__).with_name("agvs.yaml"), record_work=True)
