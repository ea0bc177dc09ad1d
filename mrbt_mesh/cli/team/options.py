"""The options by which commands find a team: its run directory, or where it is on the network."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from mrbt_mesh.cli.framework.declare import Given, option
from mrbt_mesh.cli.options import RunDirOption
from mrbt_mesh.cli.team.network_options import PANEL, TeamNetworkOptions
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.settings import MISSION_VARIABLE

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.runtime.team_address import TeamAddress

_ON_NETWORK = (
    *("--team", "--run", "--connect", "--multicast", "--router", "--transport", "--keys"),
    *("--beat", "--detection"),
)


@dataclass(frozen=True)
class TeamOptions:
    """Where a team is: the run started last, another run directory, or the network."""

    network: TeamNetworkOptions = field(default_factory=TeamNetworkOptions)
    run_dir: RunDirOption = None
    mission: Annotated[
        Path | None,
        option(
            "Its mission file. The team is looked for where its robots are with the same options.",
            "FILE",
            variable=MISSION_VARIABLE,
            panel=PANEL,
        ),
    ] = None

    def find(self, given: Given) -> TeamAddress:
        """The team that the options name.

        Raises InputError, also for options that say nothing of a team in a run directory.
        """
        from mrbt_mesh.formats.mission_file import load_mission
        from mrbt_mesh.runtime.team import address_of

        found = self.run_directory(given)
        if found is not None:
            return address_of(found)
        assert self.mission is not None
        return self.network.locate(load_mission(self.mission))

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
