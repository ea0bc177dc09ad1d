"""`mrbt freeze`."""

from __future__ import annotations

import signal

from mrbt_mesh.cli.options import RobotArgument, RunDirOption


def freeze(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Freeze a robot's process with SIGSTOP: it falls silent, but its links stay up.

    Example: mrbt freeze A1
    """
    from mrbt_mesh.cli.team.processes import send_signal

    send_signal(robot, run_dir, signal.SIGSTOP, "frozen")
