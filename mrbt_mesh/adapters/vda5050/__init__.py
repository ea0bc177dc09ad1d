"""Robots that are AGVs (VDA 5050): a robot program that is made of a layout file.

    from mrbt_mesh.adapters.vda5050 import robot_program

    robot = robot_program("agvs.yaml")     # next to this file, or an absolute path

Each robot of the team is one vehicle: its local tasks become orders. Needs the extra `vda5050`.
There is no traffic control here: routes are shortest ways, and nothing keeps vehicles apart.
docs/how-to/vda5050.md has the form of the file.
"""

from mrbt_mesh.adapters.vda5050.program import robot_program

__all__ = ["robot_program"]
