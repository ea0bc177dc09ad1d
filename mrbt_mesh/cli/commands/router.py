"""`mrbt router`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from mrbt_mesh.cli.framework.declare import option
from mrbt_mesh.cli.options import JsonOption


def router(
    listen: Annotated[
        tuple[str, ...],
        option("Endpoint to listen on. Default: port 7447, over TLS with --keys.", "tcp/IP:PORT"),
    ] = (),
    connect: Annotated[
        tuple[str, ...],
        option("Endpoint of another router; of two, one connects.", "tcp/IP:PORT"),
    ] = (),
    keys: Annotated[
        Path | None,
        option("Folder with a router's key: over tls/ or quic/IP:PORT, for members only.", "DIR"),
    ] = None,
    write_config: Annotated[
        Path | None, option("Do not run: write the same as a configuration for zenohd.", "FILE")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Pass messages on between robots that do not reach each other.

    Runs until SIGINT or SIGTERM. Robots are its clients, and need only its address. With two
    routers, one connected to the other, a team goes on when one of them dies. Teams of different
    names do not hear each other.

    Example, on two machines, and a robot:

    mrbt router

    mrbt router --connect tcp/10.0.0.1:7447

    mrbt agent --keys keys --mission mission.yaml --robot A1 --router tcp/10.0.0.1:7447
    """
    from mrbt_mesh.cli.team.routing import run, save
    from mrbt_mesh.runtime.router import RouterConfig, config_with_keys, default_endpoint

    where = listen or (default_endpoint(keys is not None),)
    if keys is None:
        config = RouterConfig(where, connect)
    else:
        config = config_with_keys(keys, where, connect)
    if write_config is not None:
        save(write_config, config)
    else:
        run(config, as_json)
