"""mrbt-mesh: fault-tolerant teams of robots on behavior trees, with no coordinator.

Robot programs import from here, and from nowhere below.
"""

from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.runtime.program import ProgramError, RobotProgram, TaskContext

__all__ = ["ProgramError", "RobotProgram", "TaskContext", "TaskFailedError", "__version__"]

__version__ = "0.1.0"
