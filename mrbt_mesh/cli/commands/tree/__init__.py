"""The commands of `mrbt tree`, a file for each, as in the package above."""

from __future__ import annotations

from mrbt_mesh.cli.framework.group import CommandGroup

PANELS = {
    "Commands": {
        "show": "Draw the trees of a file, or all that a robot of a mission runs.",
        "convert": "Write trees as BehaviorTree.CPP 4.7 to 4.10 loads them and Groot2 opens them.",
        "check": "Check a file, or all of a folder; exit status 2 if there are errors.",
    },
}
tree = CommandGroup(
    "tree",
    __name__,
    PANELS,
    text="Show, check and convert trees: BehaviorTree.CPP files and missions.",
    example="mrbt tree show examples/vehicle_repair/mission.yaml",
)
