"""The command `mrbt` with all its commands."""

from __future__ import annotations

import click

from mrbt_mesh.cli.commands import PANELS
from mrbt_mesh.cli.framework.group import CommandGroup
from mrbt_mesh.version import __version__

app = CommandGroup(
    "mrbt",
    "mrbt_mesh.cli.commands",
    PANELS,
    text="Teams of robots on one behavior tree, with no coordinator.",
    example="mrbt up examples/vehicle_repair/mission.yaml",
)
click.version_option(__version__, message=f"mrbt-mesh {__version__}", help="Print the version.")(
    app
)
