"""`mrbt kill`."""

from __future__ import annotations

import signal

from mrbt_mesh.cli.options import RobotArgument, RunDirOption


def kill(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Kill a robot's process with SIGKILL: a major fault.

    Example: mrbt kill A1
    """
    from mrbt_mesh.cli.team.processes import send_signal

    send_signal(robot, run_dir, signal.SIGKILL, "killed")
