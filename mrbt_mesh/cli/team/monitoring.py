"""A team's tree for monitors of BehaviorTree.CPP, as long as nobody stops it."""

from __future__ import annotations

import signal
import sys

import anyio
import click

from mrbt_mesh.adapters.groot2.monitor import MonitoredTree
from mrbt_mesh.adapters.groot2.viewer import answer_all, listening
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.cli.framework.exits import SUCCESS
from mrbt_mesh.cli.framework.terminal import print_json
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.team_address import TeamAddress
from mrbt_mesh.runtime.watcher import watching

# Monitors ask for statuses some ten times a second.
LOOK_S = 0.1


async def monitor(
    address: TeamAddress, tree: ObservedTree, host: str, port: int, as_json: bool
) -> int:
    """Serve a tree until SIGINT or SIGTERM; says where. Returns the exit status.

    Raises InputError if it cannot listen or the tree is too large, TransportError if there is no
    way to attach to the team.
    """
    with listening(host, port) as (socket, opened):
        async with watching(address) as watcher:
            monitored = MonitoredTree(tree, watcher.observer)
            if as_json:
                print_json({"host": host, "port": opened, "tree": tree.title})
            else:
                click.echo(f"{tree.title} on {host}:{opened}")
            sys.stdout.flush()
            async with anyio.create_task_group() as group:
                group.start_soon(answer_all, socket, monitored)
                group.start_soon(_end_on_signal, group.cancel_scope)
                while True:
                    monitored.update(boottime_us())
                    await watcher.wait_for_change(LOOK_S)
    return SUCCESS


async def _end_on_signal(scope: anyio.CancelScope) -> None:
    with anyio.open_signal_receiver(signal.SIGINT, signal.SIGTERM) as signals:
        async for _ in signals:
            scope.cancel()
            return
