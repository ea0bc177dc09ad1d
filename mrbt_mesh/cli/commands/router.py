"""`mrbt router`: forwards messages between robots that cannot reach each other."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import Any, NoReturn

import click

from mrbt_mesh.cli.command import PATH, SUCCESS, MrbtCommand
from mrbt_mesh.cli.network import endpoints_option
from mrbt_mesh.cli.options import json_option
from mrbt_mesh.runtime.settings import WARNING


@click.command(cls=MrbtCommand)
@endpoints_option("--listen", "Endpoint to listen on. Default: port 7447, with --keys over TLS.")
@endpoints_option("--connect", "Endpoint of another router; of two, one connects.")
@click.option(
    "--keys",
    type=PATH,
    metavar="DIR",
    help="Folder with a router's key: members alone may link, over TLS or QUIC.",
)
@click.option(
    "--write-config",
    type=PATH,
    metavar="FILE",
    help="Do not run; write a configuration that makes zenohd do the same.",
)
@json_option
def router(
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    keys: Path | None,
    write_config: Path | None,
    as_json: bool,
) -> None:
    """Pass messages on between robots that do not reach each other.

    Runs until SIGINT or SIGTERM. Robots are its clients and need its address alone. With two
    routers, one connected to the other, a team goes on when one of them dies. Teams of different
    names do not hear each other.

    \b
    Example, on two machines, and a robot:
      mrbt router
      mrbt router --connect tcp/10.0.0.1:7447
      mrbt agent --keys keys --mission mission.yaml --robot A1 --router tcp/10.0.0.1:7447
    """
    from mrbt_mesh.runtime import router as routing
    from mrbt_mesh.runtime.session_config import NO_IPV6, without_ipv6

    where = listen or (routing.default_endpoint(keys is not None),)
    if keys is None:
        config = routing.RouterConfig(where, connect)
    else:
        config = routing.config_with_keys(keys, where, connect)
    if write_config is not None:
        routing.write_config(write_config, config)
        click.echo(f"wrote {write_config}: zenohd -c {quote(str(write_config))}")
        return
    found = without_ipv6(where)
    if found != [*where]:
        click.echo(f"{NO_IPV6}: listening on {', '.join(found)}", err=True)
    _route(config, as_json)


def _route(config: Any, as_json: bool) -> NoReturn:
    """Route until SIGINT or SIGTERM; raises TransportError."""
    import json
    import signal
    import threading

    from mrbt_mesh.runtime.router import Router

    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    router = Router(config)
    if as_json:
        click.echo(json.dumps({"locators": router.locators}))
    else:
        if config.certificates is None:
            click.echo(f"{WARNING} everybody who reaches this router may link to it", err=True)
        for locator in router.locators:
            click.echo(f"running; robots of this network: --router {locator}")
    over.wait()
    router.close()
    raise SystemExit(SUCCESS)
