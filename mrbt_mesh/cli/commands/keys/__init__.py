"""The commands of `mrbt keys`, a file for each, as in the package above."""

from __future__ import annotations

from mrbt_mesh.cli.framework.group import CommandGroup

PANELS = {
    "Commands": {
        "init": "Make the keys of a new team.",
        "add": "Give keys to more members, or other ones to members that have some.",
        "revoke": "Let members' keys count no more; what they had written stands.",
        "show": "Tell who has a key, and for what.",
    },
}
keys = CommandGroup(
    "keys",
    __name__,
    PANELS,
    text="Make and change the keys by which a team knows who says what.",
    example="mrbt keys init keys --robots A1,B1,C1",
)
