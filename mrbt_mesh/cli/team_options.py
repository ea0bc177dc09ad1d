"""The team that a command addresses: a run of this machine, or a team on the network.

A team on the network is given by its mission file and the environment variables of `mrbt agent`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mrbt_mesh.cli.command import PATH, MrbtCommand, options_as
from mrbt_mesh.cli.network import network_option, network_options
from mrbt_mesh.cli.options import run_dir_option
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.robot_options import NetworkOptions
from mrbt_mesh.runtime.settings import MISSION_VARIABLE

if TYPE_CHECKING:
    from mrbt_mesh.runtime.run_dir import RunDir
    from mrbt_mesh.runtime.team_address import TeamAddress


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
        """Return the address of the team that the options name; raises InputError."""
        from mrbt_mesh.formats.mission_file import load_mission
        from mrbt_mesh.runtime.team_address import address_of, on_network

        found = self.run_directory()
        if found is not None:
            return address_of(found)
        assert self.mission is not None
        network: NetworkOptions = _environment.invoke(_environment.make_context("mrbt", []))
        return on_network(load_mission(self.mission), network)

    def find_running(self) -> TeamAddress:
        """Like `find`, but raises InputError for a team of this machine that no longer runs."""
        from mrbt_mesh.runtime.known_runs import is_running

        address = self.find()
        if address.run_dir is not None and not is_running(address.run_dir):
            name = address.transport.team
            raise InputError(f"team {name} does not run any more; `mrbt ls` lists those that do")
        return address

    def run_directory(self) -> RunDir | None:
        """Return the run directory that the options name; None for a team on the network.

        Raises InputError if there is none, or if the options name both.
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
    network_option(
        "--mission",
        "Mission file of a team on the network, whose MRBT_... variables are set here too.",
        MISSION_VARIABLE,
        type=PATH,
        metavar="FILE",
    ),
)
