"""The options by which commands find a team: its run directory, or where it is on the network."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import RunDirOption
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import (
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    MISSION_VARIABLE,
    RUN_VARIABLE,
    TEAM_VARIABLE,
)

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.runtime.team_address import TeamAddress

_option = partial(option, panel="A team on the network")
_ON_NETWORK = (
    *("--team", "--run", "--connect", "--multicast", "--transport", "--key", "--beat"),
    "--detection",
)


@dataclass(frozen=True)
class TeamOptions:
    """Where a team is: the run started last, another run directory, or the network."""

    run_dir: RunDirOption = None
    mission: Annotated[
        Path | None,
        _option(
            "Its mission file. The team is looked for on the network, as its robots do.",
            "FILE",
            variable=MISSION_VARIABLE,
        ),
    ] = None
    team: Annotated[
        str | None, _option("Its name, as given to robots.", "NAME", variable=TEAM_VARIABLE)
    ] = None
    run: Annotated[
        str | None, _option("Its run id, as given to robots.", "ID", variable=RUN_VARIABLE)
    ] = None
    connect: Annotated[
        tuple[str, ...],
        _option("Endpoint of a robot; name each. Default: discover them.", "tcp/IP:PORT"),
    ] = ()
    multicast: Annotated[
        str | None, _option("Network interface for discovery. Default: auto.", "INTERFACE")
    ] = None
    transport: Annotated[
        Literal["wired", "wireless"],
        _option("wired (TCP) or wireless (QUIC), as given to robots."),
    ] = "wired"
    key: Annotated[Path | None, _option("The team's key, if it is wireless.", "FILE")] = None
    beat: Annotated[
        float, _option("Heartbeat period, as given to robots.", "SECONDS", above=0, most=3600)
    ] = DEFAULT_BEAT_S
    detection: Annotated[
        float, _option("Silence until dead, as given to robots.", "SECONDS", above=0, most=3600)
    ] = DEFAULT_DETECTION_S

    def find(self, given: Given) -> TeamAddress:
        """The team that the options name.

        Raises InputError, also for options that say nothing of a team in a run directory.
        """
        found = self.run_directory(given)
        if found is not None:
            from mrbt_mesh.runtime.team import address_of

            return address_of(found)
        from mrbt_mesh.formats.mission_file import load_mission
        from mrbt_mesh.runtime.team_address import on_network

        assert self.mission is not None
        if self.transport == "wired":
            given.refuse(["--key"], "only a team with --transport wireless has a key")
        return on_network(
            load_mission(self.mission),
            team=self.team,
            run=self.run,
            connect=self.connect,
            multicast=self.multicast,
            beat_s=self.beat,
            detection_s=self.detection,
            profile=self.transport,
            key=self.key,
        )

    def run_directory(self, given: Given) -> RunDir | None:
        """The run directory that the options name; None for a team on the network.

        Raises InputError if there is none, or if they name both.
        """
        from mrbt_mesh.runtime.run_dir import RunDir

        if self.mission is None:
            given.refuse(_ON_NETWORK, "a team on the network is found with its --mission file")
            return RunDir.find(self.run_dir)
        if self.run_dir is not None:
            raise InputError(
                f"--run-dir and --mission (or {MISSION_VARIABLE}) are two ways to name a team: "
                "give one"
            )
        return None
