"""Starts robots as separate processes: endpoints, command lines, and starting one by exec.

A whole team is forked (`robot_forks`), from a process that never opened a Zenoh session: a session
would not survive the fork.
"""

from __future__ import annotations

import contextlib
import os
import random
import select
import socket
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import anyio
import anyio.abc
import psutil

from mrbt_mesh.core.membership.keys import Role
from mrbt_mesh.recording.folder import robot_file
from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.launcher_lock import is_launched
from mrbt_mesh.runtime.run_dir import RunDir, RunDirError, RunInfo
from mrbt_mesh.runtime.settings import (
    DEFAULT_GATHER_S,
    PROTOCOLS,
    START_S_PER_ROBOT,
    WIRED,
)
from mrbt_mesh.runtime.team_address import AddressError

HOST = "127.0.0.1"
# Timeout for a test connection on loopback.
LOOPBACK_S = 2.0
PORT = 7447
# Below the ports that Linux, macOS and Windows give to dialling sockets.
DATAGRAM_PORTS = range(10_000, 32_768)


def free_endpoints(count: int, protocol: str) -> list[str]:
    """Return loopback endpoints that are free now.

    On Linux no other launcher gets the ports while this process lives, because robots take a while
    to start, and teams may start side by side. Raises OSError if none is free, and AddressError if
    loopback does not work: then each robot would think that it is alone, and do all the work.
    """
    _check_loopback()
    if protocol in PROTOCOLS[WIRED]:
        ports = _stream_ports(count)
    else:
        ports = [_datagram_port() for _ in range(count)]
    return [f"{protocol}/{HOST}:{port}" for port in ports]


def _check_loopback() -> None:
    try:
        with socket.create_server((HOST, 0)) as server:
            socket.create_connection(server.getsockname()[:2], LOOPBACK_S).close()
    except OSError as error:
        raise AddressError(
            f"the robots of this run would not hear one another: {HOST} cannot be reached on this "
            f"machine ({error.strerror or error}); as root, `ip link set lo up`"
        ) from None


def _stream_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for item in sockets:
            item.bind((HOST, 0))
        ports = [item.getsockname()[1] for item in sockets]
        if sys.platform == "linux":
            for item in sockets:
                # Zenoh sets this option too, so it may listen here; a socket that asks for any port
                # does not get this one.
                item.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                item.detach()  # it stays open until this process ends
            sockets = []
    finally:
        for item in sockets:
            item.close()
    return ports


def _datagram_port() -> int:
    """Return a UDP port, reserved among launchers by the TCP port of the same number.

    A bound UDP port cannot be passed to the robot, and a free port in the range for dialling
    sockets might be taken by any robot that dials meanwhile.
    """
    for port in random.sample(DATAGRAM_PORTS, 1000):
        reservation = socket.socket()
        try:
            reservation.bind((HOST, port))
            with socket.socket(type=socket.SOCK_DGRAM) as probe:
                probe.bind((HOST, port))
        except OSError:
            reservation.close()
        else:
            reservation.detach()
            return port
    raise OSError("no UDP port is free")


def ensure_keys(run_dir: RunDir, info: RunInfo, robot: str) -> None:
    """Make keys for a robot of this run, and for an operator, where missing. Raises KeysError."""
    if info.options.insecure:
        return
    from mrbt_mesh.runtime.key_folder import OPERATOR, KeyFolder

    folder = KeyFolder(run_dir.keys_path)
    if not folder.manifest_path.exists():
        members = dict.fromkeys([*info.robots, robot], Role.ROBOT)
        operator = OPERATOR
        while operator in members:
            operator += "_"
        KeyFolder.create(folder.path, {**members, operator: Role.OPERATOR})
    elif robot not in folder.manifest().members:
        folder.add({robot: Role.ROBOT})


class StartedRobot(Protocol):
    """A robot's process as seen by its launcher."""

    @property
    def pid(self) -> int: ...

    @property
    def returncode(self) -> int | None:
        """None while it runs, or is not known to have ended; negative for a signal."""


def agent_command(info: RunInfo, robot: str, arguments: Sequence[str]) -> list[str]:
    """Return the command line of a robot's process at its place."""
    place = info.places.get(robot)
    command = [*place.prefix] if place is not None else []
    return [*command, sys.executable, "-m", "mrbt_mesh", *arguments]


def agent_arguments(
    run_dir: RunDir,
    info: RunInfo,
    robot: str,
    robot_type: str | None = None,
    takeover: bool = False,
) -> list[str]:
    """Return the `mrbt` arguments for a robot of this run, which leaves with its launcher."""
    has_router = bool(info.options.routers)
    options = replace(
        info.options,
        listen=() if has_router else (info.endpoints[robot],),
        connect=() if has_router else tuple(info.endpoints[each] for each in info.dials[robot]),
        keys=None if info.options.insecure else run_dir.keys_path,
        type=robot_type,
        expect=info.robots,
        gather_s=max(DEFAULT_GATHER_S, START_S_PER_ROBOT * len(info.robots)),
        # All robots are started here, so a robot that is not heard has ended.
        alone_after_s=0.0,
        run_dir=run_dir.path,
        takeover=takeover,
        exit_when_done=True,
        while_locked=run_dir.launcher_lock_path if is_launched(run_dir) else None,
        record=robot_file(run_dir.path, robot) if info.record else None,
        metrics_port=info.metrics_ports.get(robot),
    )
    which = ["--mission", str(run_dir.mission_path), "--robot", robot]
    return ["agent", *which, *options.arguments()]


def lower_dials(robots: Iterable[str]) -> dict[str, list[str]]:
    """Return who dials whom in a team that starts together: each robot dials those of lower id."""
    ordered = sorted(robots)
    return {robot: ordered[:index] for index, robot in enumerate(ordered)}


def with_newcomer(info: RunInfo, robot: str) -> RunInfo:
    """Return the run with a robot at a new endpoint: it dials all others, and none dials it.

    Raises RunDirError if the run has places, and none for this robot.
    """
    if info.places and robot not in info.places:
        raise RunDirError(f"this run has no place for {robot} (only {', '.join(info.places)})")
    dials = {r: [o for o in others if o != robot] for r, others in info.dials.items()}
    ports = dict(info.metrics_ports)
    if ports:
        # A robot that is replaced while it runs still holds its old port.
        ports[robot] = max(ports.values()) + 1
    return replace(
        info,
        endpoints={**info.endpoints, robot: _next_endpoint(info, robot)},
        dials={**dials, robot: sorted(r for r in info.endpoints if r != robot)},
        metrics_ports=ports,
    )


def _next_endpoint(info: RunInfo, robot: str) -> str:
    """Return a new endpoint: a robot that is replaced while it runs still holds its old one."""
    if info.options.routers:
        return ""
    protocol = next(iter(info.endpoints.values())).partition("/")[0]
    if not info.places:
        return free_endpoints(1, protocol)[0]
    old = info.endpoints.get(robot)
    port = int(old.rpartition(":")[2]) + 1 if old is not None else PORT
    return f"{protocol}/{info.places[robot].address}:{port}"


async def start_robot(
    run_dir: RunDir, robot: str, command: list[str], environment: Mapping[str, str]
) -> anyio.abc.Process:
    """Start a robot in its own session, so that it outlives the terminal.

    `environment` has variables that are added to those of this process.
    """
    with run_dir.opened_output(run_dir.output_path(robot)) as output:
        return await anyio.open_process(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=os.environ | environment,
            start_new_session=True,
        )


def wait_for_exit(pid: int) -> int:
    """Block until a process ends, which need not be a child; return when, on `boottime_us`."""
    if hasattr(os, "pidfd_open"):
        try:
            descriptor = os.pidfd_open(pid)
        except ProcessLookupError:
            return boottime_us()
        try:
            poll = select.poll()
            poll.register(descriptor, select.POLLIN)
            poll.poll()
            return boottime_us()
        finally:
            os.close(descriptor)
    with contextlib.suppress(psutil.Error):
        psutil.Process(pid).wait()
    return boottime_us()
