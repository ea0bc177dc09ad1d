"""Groups of commands, of which only the one that is called is imported."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import click

from mrbt_mesh.cli.framework.command import run
from mrbt_mesh.cli.framework.declare import command

# Panel of the help -> command -> what it is for, in one line.
Panels = Mapping[str, Mapping[str, str]]


class CommandGroup(click.Group):
    """The command `x-y` is the function, or the group, `x_y` in the module `x_y` of `package`."""

    def __init__(self, name: str, package: str, panels: Panels, text: str, example: str) -> None:
        self.panels = panels
        self.example = example
        self._package = package
        names = [name for lines in panels.values() for name in lines]
        # Click looks for similar names here; the commands themselves come from `get_command`.
        known = {name: click.Command(name) for name in names}
        super().__init__(name, known, no_args_is_help=True, help=text)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in self.commands:
            return None
        module = cmd_name.replace("-", "_")
        found = getattr(importlib.import_module(f"{self._package}.{module}"), module)
        return found if isinstance(found, click.Command) else command(found)

    def get_help(self, ctx: click.Context) -> str:
        from mrbt_mesh.cli.framework.help_screen import group_help

        return group_help(self, ctx, self.panels, self.example)

    def main(self, *args: Any, **extra: Any) -> Any:
        run(super().main, *args, **extra)
