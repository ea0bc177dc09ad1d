"""Signals to robots' processes: faults from outside, which no robot is told of."""

from __future__ import annotations

import signal
from pathlib import Path

import click
import psutil

from mrbt_mesh.cli.framework.exits import FAILURE, fail
from mrbt_mesh.errors import InputError, nearest
from mrbt_mesh.runtime.run_dir import RunDir


def send_signal(robot: str, run_dir: Path | None, number: signal.Signals, done: str) -> None:
    """Send a signal to a robot's process and say that it is `done`.

    Raises InputError if no such process runs here.
    """
    found = RunDir.find(run_dir)
    process = found.process(robot)
    if process is None:
        known = {*found.info().robots, *found.robots()}
        if robot not in known:
            hint = nearest(robot, known)
            raise InputError(f"the run in {found.path} has no robot {robot!r}{hint}")
        raise InputError(f"{robot} does not run in {found.path}; `mrbt join {robot}` starts it")
    try:
        process.send_signal(number)
    except psutil.Error as error:
        fail(f"cannot signal {robot} (pid {process.pid}): {error}", FAILURE)
    click.echo(f"{robot} (pid {process.pid}) {done}")
