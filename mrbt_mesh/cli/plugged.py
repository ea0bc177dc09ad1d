"""Options that installed views add to `watch` and `up`."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import click

from mrbt_mesh.cli.command import PORT, refuse, with_options
from mrbt_mesh.cli.options import chosen_robots
from mrbt_mesh.plugins import VIEWS, Viewer, ViewerOptions

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission

# Addresses at which a proxy may serve this machine.
_PUBLIC_URL = re.compile(r"https?://[A-Za-z0-9.\[\]:-]+(/[A-Za-z0-9._~/-]*)?")


class PublicUrl(click.ParamType[str]):
    """An address at which a proxy serves something, without a slash at its end."""

    name = "URL"

    def convert(self, value: str, _: Any, __: Any) -> str:
        """Return the address; raises click.BadParameter for an invalid one."""
        try:
            parts = urlsplit(value)
            is_address = bool(_PUBLIC_URL.fullmatch(value) and parts.hostname and parts.port != 0)
        except ValueError:  # a port or an address out of range
            is_address = False
        if not is_address:
            self.fail(f"{value!r}: an address is expected, e.g. https://robots.example/depot")
        return value.rstrip("/")


def public_url_option(what: str) -> Callable[..., Any]:
    """Return the option for the address at which a proxy serves `what`."""
    text = f"Address at which a proxy serves the {what}: https://..."
    return click.option("--public-url", type=PublicUrl(), metavar="URL", help=text)


@dataclass(frozen=True)
class ChosenViews:
    """The chosen views, by name."""

    viewers: Mapping[str, Viewer]
    options: ViewerOptions

    def check(self, mission: Mission | None = None) -> None:
        """Raise InputError, before a team is started, if a view cannot be opened.

        Also if the robot to show is not a robot of the `mission` to run.
        """
        if not self.viewers:
            views = ", ".join(f"--{name}" for name in VIEWS.names())
            options = "--host", "--port", "--public-url", "--control", "--robot"
            refuse(f"for a view: give one of {views}", *options)
        for viewer in self.viewers.values():
            viewer.check(self.options)
        if mission is not None and self.options.robot is not None:
            chosen_robots("--robot", self.options.robot, mission)


def view_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add a flag for each installed view and its options; the command gets them as `views`."""
    names = VIEWS.names()

    @functools.wraps(function)
    def call(**values: Any) -> Any:
        chosen = {name: VIEWS.load(name) for name in names if values.pop(name.replace("-", "_"))}
        options = ViewerOptions(
            values.pop("host"),
            values.pop("port"),
            values.pop("control"),
            values.pop("robot"),
            public_url=values.pop("public_url") or "",
        )
        return function(**values, views=ChosenViews(chosen, options))

    flags = [
        *(click.option(f"--{name}", is_flag=True, help=VIEWS.load(name).summary) for name in names),
        click.option("--host", default="127.0.0.1", metavar="IP", help="Address of the view."),
        click.option(
            "--port", type=PORT, metavar="PORT", help="Port of the view. Default: its own, or any."
        ),
        public_url_option("view"),
        click.option("--control", is_flag=True, help="The view may also kill, freeze, pause, ..."),
        click.option("--robot", metavar="ID", help="Show the tree of this robot in the view."),
    ]
    return with_options(call, flags)
