"""The options that say where a team is on the network: to its robots, and to who looks for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from mrbt_mesh.cli.framework.declare import option
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
    from mrbt_mesh.core.mission.mission import Mission
    from mrbt_mesh.runtime.team_address import TeamAddress

PANEL = "The team on the network"
_option = partial(option, panel=PANEL)


def warn_insecure() -> None:
    """Say on stderr that messages are not signed; robots do without what colours need."""
    import click

    text = "not secure: messages are not signed, and whoever reaches a robot's port is believed"
    click.echo(f"{WARNING} {text}", err=True)


def endpoints_of(listed: str | None) -> tuple[str, ...]:
    """`tcp/A:1,tcp/B:1` one by one."""
    return tuple(endpoint for endpoint in (listed or "").split(",") if endpoint)


@dataclass(frozen=True)
class TeamNetworkOptions:
    """Who says the same of all of these finds one another."""

    team: Annotated[
        str | None,
        _option("The team's name. Default: the mission's.", "NAME", variable=TEAM_VARIABLE),
    ] = None
    run: Annotated[
        str | None,
        _option(
            "Run id; robots of different runs ignore each other. Default: one of the mission.",
            "ID",
            variable=RUN_VARIABLE,
        ),
    ] = None
    connect: Annotated[
        tuple[str, ...],
        _option("Endpoint of another robot; name each. Default: discover them.", "tcp/IP:PORT"),
    ] = ()
    multicast: Annotated[
        str | None,
        _option("Interface for discovery. Default: auto, unless endpoints are given.", "NAME"),
    ] = None
    router: Annotated[
        str | None,
        _option(
            "Routers (`mrbt router`) to be a client of, one at a time.",
            "tcp/IP:PORT,...",
            variable=ROUTER_VARIABLE,
        ),
    ] = None
    transport: Annotated[
        Literal["wired", "wireless"],
        _option("TCP, or QUIC for lossy networks, which needs --keys."),
    ] = "wired"
    keys: Annotated[
        Path | None,
        _option("Folder of keys, made by `mrbt keys`.", "DIR", variable=KEYS_VARIABLE),
    ] = None
    beat: Annotated[float, _option("Heartbeat period.", "SECONDS", above=0, most=3600)] = (
        DEFAULT_BEAT_S
    )
    detection: Annotated[
        float, _option("Silence until a robot is dead.", "SECONDS", above=0, most=3600)
    ] = DEFAULT_DETECTION_S

    def locate(
        self, mission: Mission, robot: str = "", listen: tuple[str, ...] = ()
    ) -> TeamAddress:
        """The team of a mission, for a robot or (without one) an observer; raises InputError."""
        from mrbt_mesh.runtime.team_address import on_network

        return on_network(
            mission,
            robot=robot,
            team=self.team,
            run=self.run,
            listen=listen,
            connect=self.connect,
            multicast=self.multicast,
            beat_s=self.beat,
            detection_s=self.detection,
            profile=self.transport,
            keys=self.keys,
            routers=endpoints_of(self.router),
        )
