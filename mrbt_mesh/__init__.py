"""mrbt-mesh: fault-tolerant teams of robots on behavior trees, with no coordinator.

Robot programs import from here and, if they have trees, from `mrbt_mesh.btcpp`. Tests of robot
programs import from `mrbt_mesh.testing`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from mrbt_mesh.errors import InputError, TaskFailedError
from mrbt_mesh.version import __version__

if TYPE_CHECKING:
    from mrbt_mesh.runtime.context import RobotContext, TaskContext
    from mrbt_mesh.runtime.job_requests import JobRefusedError
    from mrbt_mesh.runtime.program import RobotProgram
    from mrbt_mesh.runtime.program_function import ProgramError
    from mrbt_mesh.runtime.robot_options import RobotOptions
    from mrbt_mesh.runtime.team_client import JobHandle, TeamClient, connect
    from mrbt_mesh.runtime.team_member import (
        Assignment,
        NotInTeamError,
        TeamMember,
        join_team,
    )
    from mrbt_mesh.runtime.threads import run_in_thread

__all__ = [
    "Assignment",
    "InputError",
    "JobHandle",
    "JobRefusedError",
    "NotInTeamError",
    "ProgramError",
    "RobotContext",
    "RobotOptions",
    "RobotProgram",
    "TaskContext",
    "TaskFailedError",
    "TeamClient",
    "TeamMember",
    "__version__",
    "connect",
    "join_team",
    "run_in_thread",
]

_MODULES = {
    "JobHandle": "team_client",
    "JobRefusedError": "job_requests",
    "TeamClient": "team_client",
    "connect": "team_client",
    "ProgramError": "program_function",
    "RobotContext": "context",
    "RobotOptions": "robot_options",
    "RobotProgram": "program",
    "TaskContext": "context",
    "run_in_thread": "threads",
}


def __getattr__(name: str) -> Any:
    """Load on first use, so that `mrbt_mesh.btcpp` can be imported without the runtime."""
    if name in __all__:
        return getattr(
            import_module(f"mrbt_mesh.runtime.{_MODULES.get(name, 'team_member')}"), name
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List all names for completion in an interactive Python, including names not loaded yet."""
    return sorted(__all__)
