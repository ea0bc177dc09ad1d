"""Words to robots: one command to one of them, and what it answers."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import NoReturn

import anyio
import click

from mrbt_mesh.cli.framework.exits import FAILURE, SUCCESS, end_process, fail
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching

CONNECT_TIMEOUT_S = 10.0


def with_team(team: TeamAddress, act: Callable[[Watcher], Awaitable[int]]) -> NoReturn:
    """Attach to a team, act once a robot is heard, and end the process with what comes back.

    Raises TransportError if there is no way to attach.
    """

    async def attach() -> int:
        async with watching(team) as watcher:
            await watcher.catch_up(CONNECT_TIMEOUT_S)
            return await act(watcher)

    end_process(anyio.run(attach))


def tell(team: TeamAddress, robot: str | None, command: str, argument: str = "") -> NoReturn:
    """Give a command to a robot (None: any living one), print its answer, and end the process."""

    async def act(watcher: Watcher) -> int:
        living = list(watcher.observer.membership.members())
        if not living:
            fail(nobody(watcher), FAILURE)
        if robot is not None and robot not in watcher.observer.robots():
            fail(f"the team has no robot {robot} ({', '.join(watcher.observer.robots())})")
        good, text = await watcher.command(robot or living[0], command, argument)
        if not good:
            fail(text, FAILURE)
        click.echo(text)
        return SUCCESS

    with_team(team, act)


def nobody(watcher: Watcher) -> str:
    """Why nobody is heard, as far as it can be told."""
    team = watcher.address
    text = f"no robot of team {team.transport.team}, run {team.run}, answers"
    refused = watcher.observer.refused
    return "; ".join([text, *(f"{robot}: {refused[robot]}" for robot in sorted(refused))])
