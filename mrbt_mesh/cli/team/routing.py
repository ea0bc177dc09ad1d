"""A router as a process: what it prints, and until when it runs."""

from __future__ import annotations

import json
import signal
import threading
from pathlib import Path
from typing import NoReturn

import click

from mrbt_mesh.cli.framework.exits import SUCCESS, end_process
from mrbt_mesh.runtime.router import Router, RouterConfig, write_config
from mrbt_mesh.runtime.settings import WARNING


def run(config: RouterConfig, as_json: bool) -> NoReturn:
    """Route until SIGINT or SIGTERM; raises TransportError."""
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    router = Router(config)
    if as_json:
        click.echo(json.dumps({"locators": router.locators}))
    else:
        if config.certificates is None:
            click.echo(f"{WARNING} whoever reaches this router may link to it", err=True)
        for locator in router.locators:
            click.echo(f"routes; robots of this network: --router {locator}")
    over.wait()
    router.close()
    end_process(SUCCESS)


def save(path: Path, config: RouterConfig) -> None:
    """Write the configuration for zenohd; raises InputError."""
    write_config(path, config)
    click.echo(f"wrote {path}: zenohd -c {path}")
