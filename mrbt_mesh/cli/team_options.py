"""The options by which commands find a team: its run directory, or where it is on the network."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import typer

from mrbt_mesh.cli.common import InputError, RunDirOption, input_errors
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import address_of
from mrbt_mesh.runtime.team_address import (
    DEFAULT_BEAT_S,
    DEFAULT_DETECTION_S,
    MISSION_VARIABLE,
    RUN_VARIABLE,
    TEAM_VARIABLE,
    TeamAddress,
    on_network,
)

_option = functools.partial(typer.Option, rich_help_panel="A team on the network")


def find_team(
    run_dir: RunDirOption = None,
    mission: Annotated[
        Path | None,
        _option(
            "--mission",
            envvar=MISSION_VARIABLE,
            help="Its mission file. The team is looked for on the network, as its robots do.",
        ),
    ] = None,
    team_name: Annotated[
        str | None, _option("--team", envvar=TEAM_VARIABLE, help="Its name, as given to robots.")
    ] = None,
    run: Annotated[
        str | None, _option("--run", envvar=RUN_VARIABLE, help="Its run id, as given to robots.")
    ] = None,
    connect: Annotated[
        list[str] | None,
        _option("--connect", help="Endpoint of a robot, tcp/IP:PORT; name each. Default: discover"),
    ] = None,
    multicast: Annotated[
        str | None, _option("--multicast", help="Network interface for discovery. Default: auto")
    ] = None,
    transport: Annotated[
        Literal["wired", "wireless"],
        _option("--transport", help="wired (TCP) or wireless (QUIC), as given to robots."),
    ] = "wired",
    key: Annotated[Path | None, _option("--key", help="The team's key, if it is wireless.")] = None,
    beat_s: Annotated[
        float, _option("--beat", help="Heartbeat period in s, as given to robots.")
    ] = DEFAULT_BEAT_S,
    detection_s: Annotated[
        float, _option("--detection", help="Silence until dead in s, as given to robots.")
    ] = DEFAULT_DETECTION_S,
) -> TeamAddress:
    """The team that the options name; raises InputError and what reading its files raises."""
    if mission is None:
        if team_name or run or connect or multicast:
            raise InputError("a team on the network is found with its --mission file")
        return address_of(RunDir.find(run_dir))
    if run_dir is not None:
        raise InputError(
            f"--run-dir and --mission (or {MISSION_VARIABLE}) are two ways to name a team: give one"
        )
    return on_network(
        load_mission(mission),
        team=team_name,
        run=run,
        connect=connect or (),
        multicast=multicast,
        beat_s=beat_s,
        detection_s=detection_s,
        profile=transport,
        key=key,
    )


def on_a_team(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of `find_team`, and the address found as its first argument."""
    options = inspect.signature(find_team).parameters.values()
    first, *own = inspect.signature(command).parameters.values()

    @functools.wraps(command)
    def with_options(**given: Any) -> None:
        with input_errors():
            address = find_team(**{option.name: given.pop(option.name) for option in options})
        command(address, **given)

    hints = get_type_hints(find_team, include_extras=True)
    hints |= get_type_hints(command, include_extras=True)
    del hints[first.name]
    with_options.__annotations__ = hints
    parameters = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY, annotation=hints[parameter.name])
        for parameter in (*own, *options)
    ]
    with_options.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return with_options
