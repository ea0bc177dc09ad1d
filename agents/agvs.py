"""The robots of examples/warehouse as AGVs of VDA 5050: all that there is to write for them.

mrbt up examples/warehouse/mission.yaml --program agents/agvs.py
"""

from pathlib import Path

from mrbt_mesh.adapters.vda5050 import robot_program

robot = robot_program(Path(__file__).parents[1] / "examples/warehouse/agvs.yaml", record_work=True)
