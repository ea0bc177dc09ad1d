"""The command `mrbt`."""

from __future__ import annotations

import click

from mrbt_mesh.cli.command import LateGroup
from mrbt_mesh.plugins import COMMANDS
from mrbt_mesh.version import __version__

SECTIONS = {
    "Run a team": {
        "demo up down": "Run an example; start a team; end it",
        "watch status ls logs": "Watch a team; who does what; teams; logs",
        "agent router keys attend": "Run one robot or router; write keys; attend",
    },
    "Act on a running team": {
        "kill freeze thaw fault": "Stop, freeze, thaw a robot; break a capability",
        "join leave borrow return": "Start, release, borrow or return a robot",
        "submit jobs job revise": "Hand in, list, change jobs; another mission",
        "pause resume abort decide": "Pause or end the mission; decide a doubt",
    },
    "Prepare and try out": {
        "new validate plan": "Write a mission, check it, plan for given facts",
        "sim drill": "Virtual time: run, chaos, estimate; real processes",
    },
}
# Modules that several commands share; every other command has a module of its own name.
MODULES = {
    "operate": "kill freeze thaw leave join borrow return attend fault pause resume abort decide",
    "runs": "ls down logs",
    "jobs": "submit job",
    "plan": "validate",
    "up": "demo",
}

main = LateGroup(
    SECTIONS,
    {name: module for module, names in MODULES.items() for name in names.split()},
    COMMANDS,
    name="mrbt",
    help="Teams of robots on one behavior tree, no coordinator. Example: mrbt demo",
    context_settings={"show_default": True},
    callback=lambda: None,
)
click.version_option(__version__, message=f"mrbt-mesh {__version__}")(main)
