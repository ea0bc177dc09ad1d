"""The network options of `up`, `agent` and `router`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, Decorator, FiniteNumber, options_as
from mrbt_mesh.cli.options import comma_list
from mrbt_mesh.runtime.robot_options import NetworkOptions
from mrbt_mesh.runtime.settings import (
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    KEYS_VARIABLE,
    ROUTER_VARIABLE,
    RUN_VARIABLE,
    TEAM_VARIABLE,
    WARNING,
)

if TYPE_CHECKING:
    pass


def network_option(
    name: str, text: str, variable: str | None = None, field: str | None = None, **settings: Any
) -> Decorator:
    plain = name.removeprefix("--")
    variable = variable or f"MRBT_{plain.upper()}"
    return click.option(
        name, field or plain, help=text, envvar=variable, show_envvar=True, **settings
    )


def endpoints_option(name: str, text: str, field: str | None = None, **settings: Any) -> Decorator:
    """Return an option for endpoints, given several times or separated by commas."""
    return click.option(
        name,
        field or name.removeprefix("--"),
        multiple=True,
        metavar="tcp/IP:PORT",
        callback=comma_list,
        help=text,
        **settings,
    )


transport_option = network_option(
    "--transport",
    "TCP, or QUIC for lossy networks.",
    type=click.Choice(("wired", "wireless")),
    default="wired",
)
router_option = endpoints_option(
    "--router",
    "Router to be a client of, in place of links between robots. With several, one is used.",
    "routers",
    envvar=ROUTER_VARIABLE,
    show_envvar=True,
)
beat_option = network_option(
    "--beat",
    "Heartbeat period.",
    field="beat_s",
    type=FiniteNumber(0, 3600, min_open=True),
    default=DEFAULT_BEAT_S,
    metavar="SECONDS",
)
detection_option = network_option(
    "--detection",
    "Silence after which a robot is declared dead.",
    field="detection_s",
    type=FiniteNumber(0, 3600, min_open=True),
    default=DEFAULT_DETECTION_S,
    metavar="SECONDS",
)


NETWORK = (
    endpoints_option("--listen", "Endpoint to listen on; quic/IP:PORT if it is wireless."),
    network_option("--team", "The team's name. Default: the mission's.", TEAM_VARIABLE),
    network_option(
        "--run", "Robots of other runs are ignored. Default: the mission's.", RUN_VARIABLE
    ),
    endpoints_option(
        "--connect",
        "Endpoint of another robot. Default: robots discover each other.",
        envvar="MRBT_CONNECT",
        show_envvar=True,
    ),
    network_option(
        "--multicast",
        "Interface for discovery. Default: auto, without endpoints.",
        metavar="INTERFACE",
    ),
    router_option,
    transport_option,
    network_option(
        "--keys", "Folder made by `mrbt keys`.", KEYS_VARIABLE, type=PATH, metavar="DIR"
    ),
    beat_option,
    detection_option,
)
network_options = options_as("network", NetworkOptions, *NETWORK)


def warn_insecure() -> None:
    """Warn on stderr that messages are not signed, in plain text: robots do not load a colour
    library.
    """
    text = "not secure: messages are not signed, and everybody who reaches a robot's port is"
    click.echo(f"{WARNING} {text} believed", err=True)
