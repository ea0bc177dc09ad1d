"""Where a team is: a run directory of this machine, or the network.

`up`, `agent` and `router` have options of the network. Other commands find a team on the network by
its mission file and the same environment variables.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mrbt_mesh.cli.command import PATH, Decorator, FiniteNumber, MrbtCommand, options_as
from mrbt_mesh.cli.options import comma_list, run_dir_option
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.robot_options import NetworkOptions
from mrbt_mesh.runtime.settings import (
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    KEYS_VARIABLE,
    MISSION_VARIABLE,
    ROUTER_VARIABLE,
    RUN_VARIABLE,
    TEAM_VARIABLE,
    WARNING,
)

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.runtime.team_address import TeamAddress


def _option(
    name: str, text: str, variable: str | None = None, field: str | None = None, **settings: Any
) -> Decorator:
    plain = name.removeprefix("--")
    variable = variable or f"MRBT_{plain.upper()}"
    return click.option(
        name, field or plain, help=text, envvar=variable, show_envvar=True, **settings
    )


def endpoints_option(name: str, text: str, field: str | None = None, **settings: Any) -> Decorator:
    """An option for endpoints, which may be given several times, or as a list with commas."""
    return click.option(
        name,
        field or name.removeprefix("--"),
        multiple=True,
        metavar="tcp/IP:PORT",
        callback=comma_list,
        help=text,
        **settings,
    )


transport_option = _option(
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
beat_option = _option(
    "--beat",
    "Heartbeat period.",
    field="beat_s",
    type=FiniteNumber(0, 3600, min_open=True),
    default=DEFAULT_BEAT_S,
    metavar="SECONDS",
)
detection_option = _option(
    "--detection",
    "Silence after which a robot is declared dead.",
    field="detection_s",
    type=FiniteNumber(0, 3600, min_open=True),
    default=DEFAULT_DETECTION_S,
    metavar="SECONDS",
)


NETWORK = (
    endpoints_option("--listen", "Endpoint to listen on; quic/IP:PORT if it is wireless."),
    _option("--team", "The team's name. Default: the mission's.", TEAM_VARIABLE),
    _option("--run", "Robots of other runs are ignored. Default: the mission's.", RUN_VARIABLE),
    endpoints_option(
        "--connect",
        "Endpoint of another robot. Default: robots discover each other.",
        envvar="MRBT_CONNECT",
        show_envvar=True,
    ),
    _option(
        "--multicast",
        "Interface for discovery. Default: auto, without endpoints.",
        metavar="INTERFACE",
    ),
    router_option,
    transport_option,
    _option("--keys", "Folder made by `mrbt keys`.", KEYS_VARIABLE, type=PATH, metavar="DIR"),
    beat_option,
    detection_option,
)
network_options = options_as("network", NetworkOptions, *NETWORK)


@click.command(cls=MrbtCommand)
@network_options
def _environment(network: NetworkOptions) -> NetworkOptions:
    return network


@dataclass(frozen=True)
class TeamOptions:
    """Where a team is: in the run that `find_run` finds, or on the network."""

    run_dir: Path | None
    mission: Path | None

    def find(self) -> TeamAddress:
        """The team that the options name; raises InputError."""
        from mrbt_mesh.formats.mission_file import load_mission
        from mrbt_mesh.runtime.team import address_of
        from mrbt_mesh.runtime.team_address import on_network

        found = self.run_directory()
        if found is not None:
            return address_of(found)
        assert self.mission is not None
        network: NetworkOptions = _environment.invoke(_environment.make_context("mrbt", []))
        return on_network(load_mission(self.mission), network)

    def run_directory(self) -> RunDir | None:
        """The run directory that the options name; None for a team on the network.

        Raises InputError if there is none, or if they name both.
        """
        from mrbt_mesh.runtime.known_runs import find_run

        if self.mission is None:
            return find_run(self.run_dir)
        if self.run_dir is None:
            return None
        raise InputError(
            f"--run-dir and --mission (or {MISSION_VARIABLE}) are two ways to name a team: give one"
        )


team_options = options_as(
    "team",
    TeamOptions,
    run_dir_option,
    _option(
        "--mission",
        "Mission file of a team on the network, whose MRBT_... variables are set here too.",
        MISSION_VARIABLE,
        type=PATH,
        metavar="FILE",
    ),
)


def warn_insecure() -> None:
    """Warn on stderr that messages are not signed; robots do not load rich for a colour."""
    text = "not secure: messages are not signed, and everybody who reaches a robot's port is"
    click.echo(f"{WARNING} {text} believed", err=True)
