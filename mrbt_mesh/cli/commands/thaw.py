"""`mrbt thaw`."""

from __future__ import annotations

import signal

from mrbt_mesh.cli.options import RobotArgument, RunDirOption


def thaw(robot: RobotArgument, run_dir: RunDirOption = None) -> None:
    """Let a frozen robot go on with SIGCONT.

    Example: mrbt thaw A1
    """
    from mrbt_mesh.cli.team.processes import send_signal

    send_signal(robot, run_dir, signal.SIGCONT, "goes on")
