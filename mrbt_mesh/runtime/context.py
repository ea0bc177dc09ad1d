"""The arguments of a robot program's functions: the robot, and the task that it performs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mrbt_mesh.core.mission.names import ALL, type_name
from mrbt_mesh.errors import nearest

if TYPE_CHECKING:
    from mrbt_mesh.runtime.task_port import AgentPort


@dataclass(frozen=True)
class Simulation:
    """What programs of simulated robots need.

    `speed`: how many times faster than the mission file says they work. `pid`: the robot's process;
    in virtual time, a number for each life of a robot. `is_virtual`: time is virtual, and all
    robots share one process and event loop. For a task: `work`, the nominal work of the local task,
    and `duration_s`, the seconds that this robot needs for it: work / (performance * speed).
    """

    speed: float = 1.0
    pid: int = 0
    is_virtual: bool = False
    work: float = 0.0
    duration_s: float = 0.0


@dataclass(frozen=True)
class RobotContext:
    """The robot to which a function belongs: for sensors and other background functions.

    `parameters` are the mission file's parameters. `capabilities` are the local tasks (types or
    ground) that the mission gives this robot.
    """

    robot: str
    robot_type: str
    capabilities: tuple[str, ...]
    parameters: Mapping[str, Any]
    simulation: Simulation
    _port: AgentPort = field(repr=False)

    def can(self, local_task: str) -> bool:
        """Return whether the mission gives this robot a task (type or ground), lost or not."""
        kind = type_name(local_task)
        return any(type_name(name) == kind for name in self.capabilities)

    def set_condition(self, name: str, value: bool, *, at_once: bool = False) -> None:
        """Set a declared condition, ground, e.g. `broken(2)`.

        In a local task it takes effect together with the task's outcome, so that no robot acts on
        one without the other; with `at_once`, and outside of a task, it takes effect now. A
        condition that is `per: robot` is set for this robot: here `holding` means `holding@A1`.
        Raises ValueError for a condition that is not declared.
        """
        self._port.set_condition(name, value, at_once)

    def read_condition(self, name: str) -> bool:
        """Return the value of a condition as this robot knows it now.

        For a condition that is `per: robot`, it is this robot's value.
        """
        return self._port.read_condition(name)

    def set_value(
        self, name: str, value: str | int | float | None, *, at_once: bool = False
    ) -> None:
        """Set an entry of the team's blackboard, e.g. `found`; None unsets it.

        It takes effect as in `set_condition`. An entry that is `per: robot` is set for this robot,
        one that is `per: job` for the task's job. A number is rounded to the entry's decimals.
        Raises ValueError for an entry that is not declared, and for a value outside its type.
        """
        self._port.set_value(name, value, at_once)

    def read_value(self, name: str) -> str | int | float | None:
        """Return the value of an entry as this robot knows it now; None: it is not set."""
        return self._port.read_value(name)

    def report_position(self, x: float, y: float, heading: float | None = None) -> None:
        """Show observers where this robot is, in the units of the mission's map.

        `heading` in radians from the x axis towards the y axis. The newest position is sent with
        each heartbeat, so it may be reported often; no plan reads it. Raises ValueError for numbers
        that are not finite or beyond a million.
        """
        self._port.report_position(x, y, heading)

    def lose_capability(
        self, local_task: str, reason: str = "", *, is_watched: bool = False
    ) -> None:
        """Declare a minor fault: this robot can no longer do `local_task` (a type, ground, or
        `all`).

        The plan gives the work to other robots. If this robot is working on it, the task is
        cancelled without an outcome, neither success nor failure. `reason`: one line of at most 200
        characters, which all observers see. `is_watched`: the program notices when it can do it
        again, so no operator can end the fault. Repeating it with the same reason changes nothing.
        Raises ValueError for a local task that the mission does not give this robot.
        """
        self._check_own(local_task, ALL)
        self._port.lose_capability(local_task, reason, is_watched)

    def defer_capability(self, local_task: str, reason: str) -> None:
        """Declare that this robot cannot do `local_task` yet, e.g. because a driver is starting.

        The plan treats it as a lost capability, but it is shown as pending and is no fault. Raises
        ValueError as `lose_capability` does.
        """
        self._check_own(local_task, ALL)
        self._port.defer_capability(local_task, reason)

    def restore_capability(self, local_task: str) -> None:
        """Declare that this robot can do `local_task` again, or now.

        It ends only what the robot's program has declared, not a fault declared by an operator or
        caused by a failed background function. Raises ValueError as `lose_capability` does.
        """
        self._check_own(local_task, ALL)
        self._port.restore_capability(local_task)

    def report_performance(self, local_task: str, performance: float) -> None:
        """Report how well this robot does `local_task` (a type or ground) from now on.

        It replaces the mission file's performance in later plans; 0 is a minor fault. Raises
        ValueError for anything but a number from 0 to 1e6, and for a local task that the mission
        does not give this robot.
        """
        self._check_own(local_task)
        self._port.report_performance(local_task, performance)

    def update_travel_times(self) -> None:
        """Have the program's `travel_time` called again, e.g. because a road is closed.

        Raises ValueError in a program without one.
        """
        self._port.update_travel_times()

    def _check_own(self, local_task: str, *more: str) -> None:
        if isinstance(local_task, str) and (local_task in more or self.can(local_task)):
            return
        known = {*self.capabilities, *map(type_name, self.capabilities), *more}
        hint = nearest(str(local_task), known)
        raise ValueError(f"{self.robot} has no local task {local_task!r:.80}{hint}")

    def record_event(self, event: Mapping[str, Any]) -> None:
        """Append one line to the run's events.jsonl, which only robots' programs write to."""
        self._port.record_event(event)

    def unix_time_s(self) -> float:
        """Return seconds since 1970; in the simulator, virtual seconds since the launch."""
        return self._port.unix_time_s()


@dataclass(frozen=True)
class TaskContext(RobotContext):
    """The local task that a function performs or bids for, and the robot that does so.

    `performance` is this robot's p(i, l) when the task began. `partners`: the other robots to which
    the plan gives the same local task.
    """

    incarnation: str
    activation: str
    global_task: str
    local_task: str
    arguments: tuple[str, ...]
    partners: tuple[str, ...]
    performance: float

    def report_progress(self, fraction: float) -> None:
        """Show observers the progress of the task, from 0 to 1."""
        self._port.report_progress(fraction)
