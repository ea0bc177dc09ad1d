"""Starts robots as processes of their own, by exec: Zenoh does not survive a fork."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace

import anyio
import anyio.abc
import psutil

from mrbt_mesh.runtime.fencing import boottime_us
from mrbt_mesh.runtime.run_dir import RunDir, RunInfo

HOST = "127.0.0.1"


def free_endpoints(count: int) -> list[str]:
    """Loopback TCP endpoints that are free now; the ports are held until all are found."""
    sockets = [socket.socket() for _ in range(count)]
    try:
        for item in sockets:
            item.bind((HOST, 0))
        return [f"tcp/{HOST}:{item.getsockname()[1]}" for item in sockets]
    finally:
        for item in sockets:
            item.close()


def agent_command(
    run_dir: RunDir,
    info: RunInfo,
    robot: str,
    *,
    robot_type: str | None = None,
    takeover: bool = False,
) -> list[str]:
    """The command line of one robot's process."""
    command = [sys.executable, "-m", "mrbt_mesh", "agent"]
    command += ["--mission", str(run_dir.mission_path), "--robot", robot]
    command += ["--team", info.team, "--run", info.run, "--run-dir", str(run_dir.path)]
    command += ["--beat", str(info.beat_s), "--detection", str(info.detection_s)]
    command += ["--speed", str(info.speed), "--expect", ",".join(info.robots)]
    command += ["--listen", info.endpoints[robot], "--exit-when-done"]
    for other in info.dials[robot]:
        command += ["--connect", info.endpoints[other]]
    if info.program is not None:
        command += ["--program", info.program]
    if robot_type is not None:
        command += ["--type", robot_type]
    if takeover:
        command.append("--takeover")
    return command


def lower_dials(robots: Iterable[str]) -> dict[str, list[str]]:
    """Who dials whom in a team that starts together: each robot those of lower id."""
    ordered = sorted(robots)
    return {robot: ordered[:index] for index, robot in enumerate(ordered)}


def with_newcomer(info: RunInfo, robot: str) -> RunInfo:
    """The run with a robot at a new endpoint: it dials everybody, nobody dials it."""
    dials = {r: [o for o in others if o != robot] for r, others in info.dials.items()}
    return replace(
        info,
        endpoints={**info.endpoints, robot: free_endpoints(1)[0]},
        dials={**dials, robot: sorted(r for r in info.endpoints if r != robot)},
    )


async def start_robot(run_dir: RunDir, robot: str, command: list[str]) -> anyio.abc.Process:
    """Start a robot in a session of its own, so that it outlives the terminal."""
    with (run_dir.path / f"{robot}.out").open("ab") as output:
        return await anyio.open_process(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def wait_for_exit(pid: int) -> int:
    """Block until a process ends; returns when, on `boottime_us`. It need not be a child."""
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
