"""The API for users' own robots: a program is an async function or class per local task.

    robot = RobotProgram()

    @robot.local_task
    async def replace_hw(task: TaskContext, part: str) -> None:
        await arm.swap(part)                     # raise, or return False: the local task failed

    @robot.bid("replace_hw")                     # where the mission has `performance: bid`
    def seconds_needed(part: str) -> float:
        return -arm.seconds_to(part)             # larger is better; a cost is a negative number

Annotations decide what a function receives: a parameter of type TaskContext or RobotContext gets
the context, the others get the arguments of the local task. Each decorator takes a name; without
one, the function's name counts.

Where the mission file has a tree for a local task, the program has the tree's leaves instead:

    @robot.action("MoveTo")
    async def move_to(goal: str) -> None: ...

A program knows nothing of the team: it performs what it is asked for, and reports the result. The
runtime cancels it through an anyio cancel scope when the plan no longer needs it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeVar, cast, overload

from mrbt_mesh.core.mission.names import ALL
from mrbt_mesh.plugins import FILE_FORMATS, LeafRegistry, tree_format
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program_function import (
    BackgroundFunction,
    ProgramError,
    ProgramFunction,
    any_function,
    background_function,
    task_function,
    travel_function,
    travel_time_function,
)

if TYPE_CHECKING:
    from mrbt_mesh.core.mission.mission import Mission

Result: TypeAlias = bool | Mapping[str, Any] | None
Bid: TypeAlias = float | None
Seconds: TypeAlias = float | None
TaskFunction: TypeAlias = Callable[..., Awaitable[Result]]
BidFunction: TypeAlias = Callable[..., Bid | Awaitable[Bid]]
TravelFunction: TypeAlias = Callable[..., Awaitable[bool | None]]
TravelTimeFunction: TypeAlias = Callable[..., Seconds | Awaitable[Seconds]]
Background: TypeAlias = Callable[..., Awaitable[None]]
MissionCheck: TypeAlias = "Callable[[Mission, Collection[str]], None]"


class TaskClass(Protocol):
    """A class for a local task: a new instance for each execution."""

    @property
    def run(self) -> TaskFunction: ...


_F = TypeVar("_F", bound=Callable[..., Any])
_N = TypeVar("_N", bound=type)
_Task = TypeVar("_Task", bound=TaskFunction)
_TaskType = TypeVar("_TaskType", bound=type[TaskClass])
_Bid = TypeVar("_Bid", bound=BidFunction)
_Travel = TypeVar("_Travel", bound=TravelFunction)
_TravelTime = TypeVar("_TravelTime", bound=TravelTimeFunction)
_Background = TypeVar("_Background", bound=Background)


class Decorate(Protocol):
    """A decorator with a name, `@decorate("name")`, or with that of the function, `@decorate`."""

    @overload
    def __call__(self, target: str) -> Callable[[_F], _F]: ...
    @overload
    def __call__(self, target: _F) -> _F: ...


class RegisterTask(Protocol):
    """The type of `local_task("name")`: it returns the function or class that it is given."""

    @overload
    def __call__(self, target: _Task) -> _Task: ...
    @overload
    def __call__(self, target: _TaskType) -> _TaskType: ...


@dataclass
class ProgramFunctions:
    """The functions that a program has registered, for the runtime.

    `travel` is called with one place, `travel_time` with two.
    """

    local_tasks: dict[str, ProgramFunction] = field(default_factory=dict)
    bids: dict[str, ProgramFunction] = field(default_factory=dict)
    travel: ProgramFunction | None = None
    travel_time: ProgramFunction | None = None
    backgrounds: list[BackgroundFunction] = field(default_factory=list)
    mission_checks: list[MissionCheck] = field(default_factory=list)
    computer_checks: list[Callable[[], None]] = field(default_factory=list)

    @cached_property
    def leaves(self) -> LeafRegistry:
        """The leaves of trees that are local tasks: see `mrbt_mesh.btcpp.Leaves`."""
        return FILE_FORMATS.load("xml").leaves()

    def local_task(self, kind: str) -> ProgramFunction | None:
        """Return the function for a local-task type, or None."""
        return self.local_tasks.get(kind, self.local_tasks.get("*"))

    def bid(self, kind: str) -> ProgramFunction | None:
        """Return the bid function for a local-task type, or None."""
        return self.bids.get(kind, self.bids.get("*"))

    def check_computer(self) -> None:
        """Call the checks of `before_start`. Raises InputError."""
        for check in self.computer_checks:
            check()


class RobotProgram:
    """Collects what one robot can do.

    `local_task` registers actions, `bid` how well it would perform them, `travel` ways to places,
    `travel_time` how long these take, and `background` sensors.

    `record_work`: every start of a local task, and its end or cancellation, is a line of the run's
    events.jsonl.
    """

    def __init__(self, *, record_work: bool = False) -> None:
        self.record_work = record_work
        self._functions = ProgramFunctions()

    @overload
    def local_task(self, target: str | None = None) -> RegisterTask: ...
    @overload
    def local_task(self, target: _Task) -> _Task: ...
    @overload
    def local_task(self, target: _TaskType) -> _TaskType: ...

    def local_task(self, target: Any = None) -> Any:
        """Register an async function for a local task, or a class with `async def run(self, ...)`.

            @robot.local_task
            async def carry(task: TaskContext, box: str) -> None: ...

        The arguments of the local task, which are texts, are converted to the types of the
        parameters: int, float, bool or str; a text that cannot be converted is a failure. A class
        is instantiated once per execution. `"*"` serves every local task without a function of its
        own. Raises ProgramError for a second registration, and for a function that cannot be
        called like this.
        """

        def register(name: str, function: Any) -> None:
            _add(self._functions.local_tasks, name, task_function(f"local task {name!r}", function))

        return _decorated(target, register)

    @overload
    def bid(self, target: str | None = None) -> Callable[[_Bid], _Bid]: ...
    @overload
    def bid(self, target: _Bid) -> _Bid: ...

    def bid(self, target: Any = None) -> Any:
        """Register a function, async or not, for this robot's performance in a local task.

        It is called once per activation if the mission has `performance: bid`, even while the robot
        is busy, and must answer soon. It returns a number from -1e6 to 1e6; larger is better, and a
        cost is a negative performance. None or an exception means no bid: this robot is chosen
        last. Arguments are converted like those of local tasks. `"*"` serves every local task
        without a function of its own. Raises ProgramError.
        """

        def register(name: str, function: Any) -> None:
            _add(self._functions.bids, name, any_function(f"bid {name!r}", function))

        return _decorated(target, register)

    def travel(self, target: _Travel) -> _Travel:
        """Register the async function that takes this robot to a place of the mission.

            @robot.travel
            async def drive(task: TaskContext, place: str) -> None: ...

        It is called before a local task whose place (`at` of the mission file) is not where the
        robot is, with the context of that local task. If it raises or returns False, the local task
        has failed, and if the local task is cancelled, so is the way. A program without such a
        function drives in the functions of its local tasks; in virtual time its robots are moved.
        Raises ProgramError for a second one, and for a function that cannot be called like this.
        """
        self._functions.travel = _only(travel_function(target), self._functions.travel)
        return target

    def travel_time(self, target: _TravelTime) -> _TravelTime:
        """Register a function, async or not, for the travel times of this robot.

            @robot.travel_time
            def seconds(origin: str, goal: str) -> float: ...

        Schedules use it instead of the mission's speeds and ways. It is called for each pair of
        places that this robot may need, when the robot starts and after
        `RobotContext.update_travel_times`. It returns seconds, at most 1e6, or None for the
        mission's value. If it raises, returns anything else, or takes more than 5 s for all pairs,
        the mission's values are used for all ways of this robot, and observers see why. Raises
        ProgramError for a second function, and for one that cannot be called like this.
        """
        function = travel_time_function(target)
        self._functions.travel_time = _only(function, self._functions.travel_time)
        return target

    @overload
    def background(self, target: _Background) -> _Background: ...
    @overload
    def background(
        self, *, costs: str | Iterable[str] = ...
    ) -> Callable[[_Background], _Background]: ...

    def background(self, target: Any = None, *, costs: str | Iterable[str] = ALL) -> Any:
        """Register an async function that runs as long as the robot: a sensor, a watchdog.

            @robot.background(costs=["go_to"])
            async def lidar(context: RobotContext) -> None: ...

        It belongs to no task: its `set_condition` takes effect at once. If it raises, the robot
        loses the local tasks in `costs` (types or ground; by default "all", with "none" nothing),
        and observers see why. It is restarted after 1 s, then after 2 s, 4 s, at most 60 s, and the
        robot has its capabilities again when it has run as long as that pause. A function that
        returns has ended, which is no fault. Raises ProgramError for any other function, and for
        other `costs`.
        """

        def register(function: Any) -> Any:
            self._functions.backgrounds.append(background_function(function, costs))
            return function

        return register if target is None else register(target)

    # -- leaves of BehaviorTree.CPP trees: `@robot.action`, or `@robot.action("Name")` --------

    @property
    def action(self) -> Decorate:
        """Register an action of BehaviorTree.CPP trees: a function of its ports.

        See `mrbt_mesh.btcpp.Leaves.action` and docs/how-to/robot-trees.md. Raises LeafError.
        """
        return self._leaf("action")

    @property
    def condition(self) -> Decorate:
        """Register a condition of such trees, which answers at once. Raises LeafError."""
        return self._leaf("condition")

    @property
    def node(self) -> Decorate:
        """Register a control or decorator of such trees, a subclass of `mrbt_mesh.btcpp.TreeNode`.

        Raises LeafError.
        """
        return self._leaf("node")

    @property
    def entry(self) -> Decorate:
        """Register a function for an entry of such trees that is only read; called before a tick.

            @robot.entry
            def battery_percent() -> float: ...

        None: no value. Raises LeafError.
        """
        return self._leaf("entry")

    @property
    def source(self) -> Decorate:
        """Register what Nav2's nodes ask for: see `mrbt_mesh.btcpp.Leaves.source`."""
        return self._leaf("source")

    def _leaf(self, kind: str) -> Decorate:
        def register(name: str, target: Any) -> None:
            getattr(self._functions.leaves, kind)(name)(target)

        decorate: Any = partial(_decorated, register=register)
        return cast(Decorate, decorate)

    def enum(self, name: str, number: int) -> None:
        """Define a named number for the scripts of such trees."""
        self._functions.leaves.enums[name] = number

    async def run_tree(
        self, task: TaskContext, path: Path | str, tree: str | None = None, **ports: Any
    ) -> None:
        """Run a BehaviorTree.CPP tree, with `ports` as its entries, in a local task.

            @robot.local_task
            async def fetch(task: TaskContext, where: str) -> None:
                await robot.run_tree(task, "fetch.xml", "Fetch", goal=where)

        Raises TaskFailedError unless it succeeds, with the reason of the leaf that failed last, and
        FileError.
        """
        leaves = self._functions.leaves
        await tree_format(str(path)).run_file(Path(path), tree, leaves, task, ports)

    # -- checks -------------------------------------------------------------------------------

    def for_mission(self, check: MissionCheck) -> None:
        """Register `check(mission, robots)`, called before this program is used for a mission.

        It raises InputError for what does not fit, e.g. a robot that a configuration file lacks.
        """
        self._functions.mission_checks.append(check)

    def before_start(self, check: Callable[[], None]) -> None:
        """Register `check()`, called before a robot with this program starts.

        It raises InputError for what this computer lacks: a library, a device, another Python.
        """
        self._functions.computer_checks.append(check)


def functions_of(program: RobotProgram) -> ProgramFunctions:
    """Return the functions that a program has registered, for the runtime and tests."""
    return program._functions


def _decorated(target: Any, register: Callable[[str, Any], object]) -> Any:
    """Implement all forms of a decorator: `@decorate("name")`, `@decorate` and `@decorate()`.

    The last two use the function's name.
    """
    if target is None:
        return partial(_decorated, register=register)
    if not isinstance(target, str):
        register(getattr(target, "__name__", repr(target)), target)
        return target

    def decorate(function: Any) -> Any:
        register(target, function)
        return function

    return decorate


def _only(function: ProgramFunction, first: ProgramFunction | None) -> ProgramFunction:
    """Return the function. Raises ProgramError if it is not the first of its kind."""
    if first is not None:
        kind = function.what.partition(" function")[0]
        text = f"a program has one {kind} function; the first is at {first.place}"
        raise ProgramError(f"{function.what}: {text}")
    return function


def _add(known: dict[str, ProgramFunction], name: str, function: ProgramFunction) -> None:
    if not name:
        raise ProgramError(f"{function.what}: the name is empty")
    if name in known:
        first = known[name].place
        raise ProgramError(f"{function.what} is registered twice, first at {first}")
    known[name] = function
