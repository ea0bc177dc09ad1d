"""The command `mrbt`."""

from __future__ import annotations

import click

from mrbt_mesh.cli.command import LateGroup, Row
from mrbt_mesh.plugins import COMMANDS
from mrbt_mesh.version import __version__

_COMMANDS = "mrbt_mesh.cli.commands"
SECTIONS: dict[str, list[Row]] = {
    "Run a team": [
        ("demo up", f"{_COMMANDS}.up", "Run an example; start a mission's robots"),
        ("watch", f"{_COMMANDS}.watch", "Watch a team: here, --web, --top or --groot2"),
        ("status", f"{_COMMANDS}.status", "Who does what, what is blocked, do all agree"),
        ("agent router", f"{_COMMANDS}.agent", "Run one robot, or a router, on any machine"),
    ],
    "Act on a running team": [
        ("kill freeze thaw leave", f"{_COMMANDS}.orders", "Stop, freeze, thaw or release a robot"),
        ("join", f"{_COMMANDS}.orders", "Start one more robot, or a dead one again"),
        ("fault", f"{_COMMANDS}.orders", "Have a robot lose a capability, or end that"),
        ("pause resume abort", f"{_COMMANDS}.orders", "Pause, resume or end the mission"),
        ("decide", f"{_COMMANDS}.orders", "Decide about an exclusive task in doubt"),
    ],
    "Prepare and try out": [
        ("new", f"{_COMMANDS}.new", "Write a mission and a robot of your own"),
        ("validate plan", f"{_COMMANDS}.plan", "Check a mission; plan for given facts"),
        ("sim", f"{_COMMANDS}.sim", "Run it in virtual time: run, chaos, estimate"),
        ("drill", f"{_COMMANDS}.drill", "Run real processes with faults, and judge them"),
        ("keys", f"{_COMMANDS}.keys", "Make and change a team's keys"),
    ],
}

main = LateGroup(
    SECTIONS,
    COMMANDS,
    name="mrbt",
    help="Teams of robots on one behavior tree, no coordinator. Example: mrbt demo",
    context_settings={"show_default": True},
    callback=lambda: None,
)
click.version_option(__version__, message=f"mrbt-mesh {__version__}")(main)
