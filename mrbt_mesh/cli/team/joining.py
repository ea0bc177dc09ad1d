"""A robot that joins a run of this machine: one more, or a dead one again."""

from __future__ import annotations

from pathlib import Path

import anyio
import click

from mrbt_mesh.cli.framework.exits import FAILURE, SUCCESS, end_process, fail
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import is_robot_id
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.run_dir import RunDir
from mrbt_mesh.runtime.team import Team, address_of
from mrbt_mesh.runtime.watcher import watching

JOIN_TIMEOUT_S = 30.0


def start_one(robot: str, robot_type: str | None, takeover: bool, run_dir: Path | None) -> None:
    """Start a robot's process and see that it is not refused; raises InputError."""
    found = RunDir.find(run_dir)
    info = found.info()
    mission = load_mission(found.mission_path)
    _check(mission, robot, robot_type)
    running = found.process(robot)
    if running is not None and not takeover:
        raise InputError(
            f"robot {robot} is already running (pid {running.pid}): stop it first, "
            "or replace it with --takeover"
        )
    team = Team(found, info, mission)

    async def start() -> int | None:
        """The robot's exit status if it ends instead of joining, None if it has joined."""
        process = await team.start(robot, robot_type=robot_type, takeover=takeover)
        async with watching(address_of(found)) as watcher:
            with anyio.fail_after(JOIN_TIMEOUT_S):
                while process.returncode is None:
                    await watcher.wait_for_change(watcher.timing.heartbeat_us / SECOND_US)
                    member = watcher.observer.facts.members.get(robot)
                    if member is not None and member[0].pid == process.pid:
                        return None
        return process.returncode

    try:
        code = anyio.run(start)
    except TimeoutError:
        fail(f"{robot} runs, and has not joined within {JOIN_TIMEOUT_S:g} s", FAILURE)
    if code is not None and code != 0:
        fail(found.output_path(robot).read_text().strip().rpartition("\n")[2], code)
    click.echo(f"{robot} joined")
    end_process(SUCCESS)


def _check(mission: Mission, robot: str, robot_type: str | None) -> None:
    if not is_robot_id(robot):
        raise InputError(f"robot id {robot!r}: 1 to 32 letters, digits, '_' or '-'")
    types = ", ".join(sorted(mission.robot_types))
    if robot_type is not None and robot_type not in mission.robot_types:
        raise InputError(f"--type {robot_type}: the mission has no such robot type ({types})")
    if robot_type is None and robot not in mission.robots:
        raise InputError(f"the mission has no robot {robot}: give its --type ({types})")
