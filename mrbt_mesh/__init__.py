"""mrbt-mesh: fault-tolerant teams of robots on behavior trees, with no coordinator.

Robot programs import from here and, where they have trees, from `mrbt_mesh.local`; tests of them
from `mrbt_mesh.testing`.
"""

from typing import TYPE_CHECKING, Any

from mrbt_mesh.errors import InputError, TaskFailedError
from mrbt_mesh.runtime.program import RobotProgram, TaskContext
from mrbt_mesh.runtime.program_function import ProgramError
from mrbt_mesh.version import __version__

if TYPE_CHECKING:
    from mrbt_mesh.runtime.team_member import (
        Assignment,
        JoinOptions,
        NotInTeamError,
        TeamMember,
        join_team,
    )

__all__ = [
    "Assignment",
    "InputError",
    "JoinOptions",
    "NotInTeamError",
    "ProgramError",
    "RobotProgram",
    "TaskContext",
    "TaskFailedError",
    "TeamMember",
    "__version__",
    "join_team",
]


def __getattr__(name: str) -> Any:
    """Robots inside other programs: loaded when asked for, since every robot loads this module."""
    if name in __all__:
        from mrbt_mesh.runtime import team_member

        return getattr(team_member, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
