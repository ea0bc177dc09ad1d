"""The API for users' own robots: a program is an async function or class per local task.

    robot = RobotProgram()

    @robot.local_task("replace_hw")
    async def replace_hw(task: TaskContext, part: str) -> None:
        await arm.swap(part)                     # raise, or return False: the local task failed

    @robot.bid("replace_hw")                     # where the mission says `performance: bid`
    def bid(task: TaskContext, part: str) -> float:
        return -arm.seconds_to(part)             # larger is better; a cost is a negative one

Where the mission file has a tree for a local task, the program has the tree's actions instead; of
a BehaviorTree.CPP tree its leaves:

    @robot.action("MoveTo")
    async def move_to(task: TaskContext, goal: str) -> None: ...

A program knows nothing of the team: it does what it is asked and says how it went. The
runtime cancels it through an anyio cancel scope when the plan no longer wants it.
"""

from __future__ import annotations

import copy
from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, Protocol, TypeAlias, TypeVar, overload

from mrbt_mesh.core.mission.names import ALL, type_name
from mrbt_mesh.errors import nearest
from mrbt_mesh.plugins import FILE_FORMATS, LeafRegistry, tree_format
from mrbt_mesh.runtime.program_function import (
    BackgroundFunction,
    ProgramError,
    ProgramFunction,
    any_function,
    background_function,
    checked_name,
    task_function,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission

_F = TypeVar("_F", bound=Callable[..., Any])
_N = TypeVar("_N", bound=type)


class TaskPort(Protocol):
    """What the runtime, or the simulator, provides behind a context."""

    def set_condition(self, name: str, value: bool, at_once: bool) -> None: ...
    def read_condition(self, name: str) -> bool: ...
    def set_conditions(self, values: Mapping[str, bool]) -> None: ...
    def set_local_condition(self, name: str, value: bool, at_once: bool) -> None: ...
    def read_local_condition(self, name: str) -> bool: ...
    def report_progress(self, fraction: float) -> None: ...
    def report_position(self, x: float, y: float, heading: float | None) -> None: ...
    def lose_capability(self, local_task: str, reason: str) -> None: ...
    def defer_capability(self, local_task: str, reason: str) -> None: ...
    def restore_capability(self, local_task: str) -> None: ...
    def report_performance(self, local_task: str, performance: float) -> None: ...
    def record_event(self, event: Mapping[str, Any]) -> None: ...
    def unix_time_s(self) -> float: ...


@dataclass(frozen=True)
class TaskContext:
    """What a local task gets beside its arguments.

    `performance` is this robot's p(i, l) when the task began, `work` the local task's nominal
    work; a simulated robot needs work / (performance * speed) seconds. `partners` are the other
    robots that the plan has on the same local task. `parameters` are the mission file's parameters.
    `capabilities`: the local tasks (types or ground) that the mission gives this robot.
    `is_virtual`: a simulation in virtual time, where all robots share one process and event loop.
    """

    robot: str
    robot_type: str
    incarnation: str
    pid: int
    activation: str
    global_task: str
    local_task: str
    arguments: tuple[str, ...]
    partners: tuple[str, ...]
    performance: float
    work: float
    speed: float
    parameters: Mapping[str, Any]
    port: TaskPort
    is_virtual: bool = False
    capabilities: tuple[str, ...] = ()

    def can(self, local_task: str) -> bool:
        """Whether the mission gives this robot a local task (a type or ground), lost or not."""
        kind = type_name(local_task)
        return any(type_name(name) == kind for name in self.capabilities)

    def set_condition(self, name: str, value: bool, *, at_once: bool = False) -> None:
        """Set a declared condition, ground, e.g. `broken(2)`.

        It is told to the team in one step with this task's outcome, so that nobody acts on one
        without the other; `at_once` tells it now. Of a condition that is `per: robot` it sets this
        robot's own, here `holding` means `holding@A1`. Raises ValueError if it is not declared.
        """
        self.port.set_condition(name, value, at_once)

    def condition(self, name: str) -> bool:
        """The condition's value as this robot knows it now; of one `per: robot` its own."""
        return self.port.read_condition(name)

    def set_local_condition(self, name: str, value: bool, *, at_once: bool = False) -> None:
        """Set a condition of this robot's own, ground, e.g. `holding(2)`.

        It is for the trees of local tasks (`local_conditions` of the mission file); the team never
        hears of it, and it lives as long as the robot's process. It changes when this action ends
        by itself, after its outcome; `at_once`: now. Raises ValueError if it is not declared.
        """
        self.port.set_local_condition(name, value, at_once)

    def local_condition(self, name: str) -> bool:
        """The value of a condition of this robot's own."""
        return self.port.read_local_condition(name)

    def report_progress(self, fraction: float) -> None:
        """Tell observers how far the task is, 0 to 1."""
        self.port.report_progress(fraction)

    def report_position(self, x: float, y: float, heading: float | None = None) -> None:
        """Tell observers where this robot is, in the units of the mission's map.

        `heading` in radians from the x axis towards the y axis. The newest one goes out with each
        heartbeat, so as often as one likes; no plan reads it. Raises ValueError for what is not a
        finite number, or is beyond a million.
        """
        self.port.report_position(x, y, heading)

    def lose_capability(self, local_task: str, reason: str = "") -> None:
        """Declare a minor fault: this robot can no longer do `local_task` (a type or ground), or
        `all`.

        The plan gives the work to other robots. If this robot is working on it, that is cancelled
        and has no outcome, neither success nor failure. `reason` is one line of at most 200
        characters, which everybody sees. Repeating it with the same reason changes nothing.
        Raises ValueError for what the mission does not give this robot.
        """
        self._check_own(local_task, ALL)
        self.port.lose_capability(local_task, reason)

    def defer_capability(self, local_task: str, reason: str) -> None:
        """Declare that this robot cannot do `local_task` yet, e.g. since a driver is starting.

        The plan does as for a lost capability, but it is shown as not there yet and is no fault.
        Raises ValueError as `lose_capability` does.
        """
        self._check_own(local_task, ALL)
        self.port.defer_capability(local_task, reason)

    def restore_capability(self, local_task: str) -> None:
        """Declare that this robot can do `local_task` again, or now.

        It takes back what the robot's program has declared, not what an operator has, nor what a
        background function that has failed costs. Raises ValueError as `lose_capability` does.
        """
        self._check_own(local_task, ALL)
        self.port.restore_capability(local_task)

    def report_performance(self, local_task: str, performance: float) -> None:
        """Tell how well this robot does `local_task` (a type or ground) from now on.

        It replaces the mission file's performance in the plans to come; 0 is a minor fault. Raises
        ValueError for anything but a number from 0 to 1e6, and for what the mission does not give
        this robot.
        """
        self._check_own(local_task)
        self.port.report_performance(local_task, performance)

    def _check_own(self, local_task: str, *more: str) -> None:
        if isinstance(local_task, str) and (local_task in more or self.can(local_task)):
            return
        known = {*self.capabilities, *map(type_name, self.capabilities), *more}
        hint = nearest(str(local_task), known)
        raise ValueError(f"{self.robot} has no local task {local_task!r:.80}{hint}")

    def record_event(self, event: Mapping[str, Any]) -> None:
        """Append one line to the run's events.jsonl. Only robots write there, never the mesh."""
        self.port.record_event(event)

    def unix_time_s(self) -> float:
        """Seconds since 1970; virtual in the simulator."""
        return self.port.unix_time_s()


Result: TypeAlias = bool | Mapping[str, bool] | None
Bid: TypeAlias = float | None
TaskFunction: TypeAlias = Callable[Concatenate[TaskContext, ...], Awaitable[Result]]
BidFunction: TypeAlias = Callable[Concatenate[TaskContext, ...], Bid | Awaitable[Bid]]
Background: TypeAlias = Callable[[TaskContext], Awaitable[None]]
MissionCheck: TypeAlias = "Callable[[Mission, Collection[str]], None]"


class TaskClass(Protocol):
    """A class for a local task: a new instance for each execution."""

    @property
    def run(self) -> TaskFunction: ...


_Task = TypeVar("_Task", bound=TaskFunction)
_TaskType = TypeVar("_TaskType", bound=type[TaskClass])
_Bid = TypeVar("_Bid", bound=BidFunction)
_Background = TypeVar("_Background", bound=Background)


class RegisterTask(Protocol):
    """What `local_task` returns: it hands back the function, or the class, that it is given."""

    @overload
    def __call__(self, target: _Task) -> _Task: ...
    @overload
    def __call__(self, target: _TaskType) -> _TaskType: ...


class RobotProgram:
    """Collects what one robot can do: `local_task` for actions, `bid` for how well it would do
    them, `background` for sensors.

    `record_work`: every start of a local task, and its end or cancellation, is a line of the run's
    events.jsonl.
    """

    def __init__(self, *, record_work: bool = False) -> None:
        self.record_work = record_work
        self.backgrounds: list[BackgroundFunction] = []
        self._checks: list[Callable[[], None]] = []
        self._mission_checks: list[MissionCheck] = []
        self._tasks: dict[str, ProgramFunction] = {}
        self._bids: dict[str, ProgramFunction] = {}

    def local_task(self, name: str) -> RegisterTask:
        """Register an async function `f(task, ...)`, or a class with `async run(self, task, ...)`.

        The arguments of the local task, which are texts, become what the parameters' annotations
        say: int, float, bool or str; a text that does not convert is a failure. A class is
        instantiated once per execution. `"*"` serves every local task that has none of its own.
        Raises ProgramError for a second registration and for a function that cannot be called so.
        """
        checked_name("local_task", name)

        def register(target: Any) -> Any:
            _add(self._tasks, name, task_function(f"local task {name!r}", target))
            return target

        return register

    @cached_property
    def leaves(self) -> LeafRegistry:
        """The leaves of BehaviorTree.CPP trees that are local tasks: `mrbt_mesh.btcpp.Leaves`."""
        return FILE_FORMATS.load("xml").leaves()

    def action(self, name: str) -> Callable[[_F], _F]:
        """Register an action of BehaviorTree.CPP trees: a function of its ports.

        A parameter of type TaskContext gets the context of the local task whose tree it is. See
        `mrbt_mesh.btcpp.Leaves.action` and docs/robot_trees.md. Raises LeafError.
        """
        return self.leaves.action(name)

    def condition(self, name: str) -> Callable[[_F], _F]:
        """Register a condition of such trees, which answers at once. Raises LeafError."""
        return self.leaves.condition(name)

    def node(self, name: str) -> Callable[[_N], _N]:
        """Register a control or decorator of such trees, a subclass of `mrbt_mesh.btcpp.TreeNode`.

        Raises LeafError.
        """
        return self.leaves.node(name)

    def entry(self, name: str) -> Callable[[_F], _F]:
        """Register what says an entry of such trees before each tick, for what they only read.

            @robot.entry("battery_percent")
            def battery(task: TaskContext) -> float: ...

        The parameter may be left out. None: no value. Raises LeafError.
        """
        return self.leaves.entry(name)

    def source(self, name: str) -> Callable[[_F], _F]:
        """Register what Nav2's nodes ask for: see `mrbt_mesh.btcpp.Leaves.source`."""
        return self.leaves.source(name)

    def enum(self, name: str, number: int) -> None:
        """Give a name in the scripts of such trees its number."""
        self.leaves.enums[name] = number

    async def run_tree(
        self, task: TaskContext, path: Path | str, tree: str | None = None, **ports: Any
    ) -> None:
        """Run a BehaviorTree.CPP tree, with `ports` as its entries, in a local task.

            @robot.local_task("fetch")
            async def fetch(task: TaskContext, where: str) -> None:
                await robot.run_tree(task, "fetch.xml", "Fetch", goal=where)

        Raises TaskFailedError unless it succeeds, with the reason of the leaf that failed last, and
        FileError.
        """
        await tree_format(str(path)).run_file(Path(path), tree, self.leaves, task, ports)

    def bid(self, name: str) -> Callable[[_Bid], _Bid]:
        """Register `f(task, ...)`, async or not: this robot's performance in a local task.

        It is asked once per activation where the mission says `performance: bid`, also while the
        robot is busy, and has to answer soon. It returns a number from -1e6 to 1e6, larger is
        better; a cost is a negative performance. None, or an exception: no bid, which makes this
        robot the last to be chosen. Arguments are converted as those of local tasks. `"*"` serves
        every local task that has none of its own. Raises ProgramError.
        """
        checked_name("bid", name)

        def register(target: _Bid) -> _Bid:
            _add(self._bids, name, any_function(f"bid {name!r}", target))
            return target

        return register

    @overload
    def background(self, function: _Background) -> _Background: ...
    @overload
    def background(
        self, *, costs: str | Iterable[str] = ...
    ) -> Callable[[_Background], _Background]: ...

    def background(self, function: Any = None, *, costs: str | Iterable[str] = ALL) -> Any:
        """Register an async function that runs as long as the robot does: a sensor, a watchdog.

            @robot.background(costs=["go_to"])
            async def lidar(task: TaskContext) -> None: ...

        It takes the context alone, which belongs to no activation: its `set_condition` always
        takes effect at once. If it raises, the robot loses the local tasks in `costs` (types or
        ground), by default "all", and with "none" nothing; everybody sees why. It is started again
        after 1 s, then after 2 s, 4 s, at most 60 s, and the robot has its capabilities again
        when it has run for as long as it waited before. One that returns has ended, which is no
        fault. Raises ProgramError for any other function, and for other `costs`.
        """

        def register(target: Any) -> Any:
            self.backgrounds.append(background_function(target, costs))
            return target

        return register if function is None else register(function)

    def for_mission(self, check: MissionCheck) -> None:
        """Have `check(mission, robots)` called before this program is used for a mission.

        It raises InputError for what does not fit, e.g. a robot that a file of its own lacks.
        """
        self._mission_checks.append(check)

    def check_mission(self, mission: Mission, robots: Collection[str]) -> None:
        """Call the checks of `for_mission`. Raises InputError."""
        for check in self._mission_checks:
            check(mission, robots)

    def before_start(self, check: Callable[[], None]) -> None:
        """Have `check` called before a robot with this program starts.

        It raises InputError for what this computer lacks: a library, a device, another Python.
        """
        self._checks.append(check)

    def check_computer(self) -> None:
        """Call the checks of `before_start`. Raises InputError."""
        for check in self._checks:
            check()

    def recorded(self) -> RobotProgram:
        """This program with `record_work`, whether it has that by itself or not."""
        if self.record_work:
            return self
        program = copy.copy(self)
        program.record_work = True
        return program

    def find(self, local_task_type: str) -> ProgramFunction | None:
        """The function for a local-task type, or None. It is called with the arguments' texts."""
        return self._tasks.get(local_task_type, self._tasks.get("*"))

    def find_bid(self, local_task_type: str) -> ProgramFunction | None:
        """The function that bids for a local-task type, or None."""
        return self._bids.get(local_task_type, self._bids.get("*"))

    def names(self) -> list[str]:
        """The local tasks that have a function of their own, sorted."""
        return sorted(self._tasks.keys() - {"*"})


def _add(known: dict[str, ProgramFunction], name: str, function: ProgramFunction) -> None:
    if name in known:
        first = known[name].place
        raise ProgramError(f"{function.what} is registered twice, first at {first}")
    known[name] = function
