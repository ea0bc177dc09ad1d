"""A team in this terminal, until its viewer quits."""

from __future__ import annotations

import signal
from typing import Any

import anyio

from mrbt_mesh.cli.framework.exits import SUCCESS
from mrbt_mesh.cli.team.joined_late import past_of
from mrbt_mesh.drills.control import Control, OrderError
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team import Team
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import Watcher, watching
from mrbt_mesh.views.terminal.app import LOOK_S, Orders, TeamTop


async def show(address: TeamAddress, has_control: bool) -> int:
    """Show it until the viewer quits, or SIGTERM; raises TransportError or InputError."""
    found = address.run_dir
    team = Team(found, found.info(), address.mission) if found is not None else None
    async with watching(address, tell_past=past_of(team)) as watcher:
        if team is not None and not team.living():
            # It is over: what its journals hold is all there is to see.
            team.result(watcher.observer, boottime_us())
        async with anyio.create_task_group() as group:
            orders = orders_of(Control(watcher, team, group)) if has_control else None
            app = TeamTop(watcher.observer, boottime_us, orders)
            group.start_soon(_keep_up, watcher)
            group.start_soon(_end_on_signal, app)
            if team is not None:
                group.start_soon(team.note_exits, watcher)
            await app.run_async()
            group.cancel_scope.cancel()
    return SUCCESS


def orders_of(control: Control) -> Orders:
    """What may be ordered by keys is what may be ordered by the page's buttons."""
    offers = control.offers()

    async def carry_out(order: dict[str, Any]) -> tuple[bool, str]:
        try:
            return True, await control.carry_out(order)
        except OrderError as error:
            return False, str(error)

    return Orders(carry_out, offers["robot"], offers["team"])


async def _keep_up(watcher: Watcher) -> None:
    while True:
        await watcher.wait_for_change(watcher.timing.heartbeat_us / 1e6)
        # What comes in the meantime is taken together.
        await anyio.sleep(LOOK_S / 2)


async def _end_on_signal(app: TeamTop) -> None:
    with anyio.open_signal_receiver(signal.SIGTERM) as signals:
        async for _ in signals:
            app.exit()
