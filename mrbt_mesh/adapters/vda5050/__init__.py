"""VDA 5050 vehicles (AGVs): makes a robot program from a layout file.

    from mrbt_mesh.adapters.vda5050 import robot_program

    robot = robot_program("agvs.yaml")     # next to this file, or an absolute path

Each robot of the team is one vehicle: its local tasks become orders. Needs the extra `vda5050`.
There is no traffic control: vehicles take shortest routes, and nothing keeps them apart.
docs/how-to/vda5050.md describes the file.
"""

from mrbt_mesh.adapters.vda5050.program import robot_program

__all__ = ["robot_program"]
