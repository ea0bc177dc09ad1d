"""The commands of `mrbt tree`, a file for each, as in the package above."""

from __future__ import annotations

from mrbt_mesh.cli.framework.group import CommandGroup

PANELS = {
    "Commands": {
        "show": "Draw the trees of a file, or all that a robot of a mission runs.",
        "convert": "Write a tree as BehaviorTree.CPP 4 XML that Groot2 opens: explicit, with all "
        "models.",
        "check": "Check a file; exit status 2 if there are errors.",
    },
}
tree = CommandGroup(
    "tree",
    __name__,
    PANELS,
    text="Show, check and convert trees: BehaviorTree.CPP files and missions.",
    example="mrbt tree show examples/vehicle_repair/mission.yaml",
)
