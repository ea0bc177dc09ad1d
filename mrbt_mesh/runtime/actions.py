"""Runs a robot's program for the agent: starts and cancels actions, hands back how they ended.

Used by the real runtime and, on a virtual clock, by the simulator.
"""

from __future__ import annotations

import asyncio
import inspect
import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from itertools import product
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import anyio
import anyio.abc
import anyio.lowlevel

from mrbt_mesh.core.agent.effects import (
    CancelAction,
    FeatureEffect,
    StartAction,
    UseMission,
)
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    Input,
    ProblemFound,
    TravelTimesMade,
)
from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import NO_TRAVEL_TIMES, TravelTimes
from mrbt_mesh.core.mission.conditions import truth_of
from mrbt_mesh.core.mission.jobs import program_tree
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.mission.names import ALL, split_call, type_name, with_entries
from mrbt_mesh.core.mission.travel import MAX_MS, MAX_TIMED_PLACES
from mrbt_mesh.plugins import tree_format
from mrbt_mesh.runtime.backgrounds import BackgroundRunner
from mrbt_mesh.runtime.context import RobotContext, Simulation, TaskContext
from mrbt_mesh.runtime.program import RobotProgram, TaskFunction, functions_of
from mrbt_mesh.runtime.program_function import BackgroundFunction, ProgramFunction
from mrbt_mesh.runtime.program_loader import check_program
from mrbt_mesh.runtime.step_gate import StepGate
from mrbt_mesh.runtime.task_port import AgentPort, Host
from mrbt_mesh.runtime.user_code import UserCall, UserCodeError, failure_of, wrong_result

if TYPE_CHECKING:
    from mrbt_mesh.runtime.bid_calls import BidCalls

_T = TypeVar("_T")
EXPECTED = (
    "return None or True for success, False for failure, "
    "or {condition: bool} for success with conditions"
)
ProgramEffect: TypeAlias = StartAction | CancelAction | FeatureEffect | UseMission
# Cancelled code that still runs after this time is reported.
CANCEL_LIMIT_S = 5.0
# Limit for computing the travel times between all places of a robot.
TRAVEL_TIMES_LIMIT_S = 5.0


@dataclass(frozen=True)
class RobotIdentity:
    """The robot that runs a program, as shown in the program's contexts."""

    robot: str
    type: str
    pid: int
    speed: float
    capabilities: tuple[str, ...] = ()
    is_virtual: bool = False


def travel_ms(value: Any, function: Callable[..., Any]) -> int | None:
    """Return a travel time in ms, or None for none. Raises UserCodeError for an invalid value."""
    if value is None:
        return None
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 <= float(value) * 1_000 <= MAX_MS:
        expected = f"a travel time is a number of seconds from 0 to {MAX_MS // 1_000}, or None"
        raise wrong_result(function, value, expected)
    return round(float(value) * 1_000)


async def drives_itself(task: TaskContext, place: str) -> None:
    """Default travel function: do nothing, because the program drives in its local tasks."""


class ActionRunner:
    """Runs actions, and what features ask of the program, as tasks of `group`.

    Each action ends in exactly one input to the host. `gate` must be told when the agent has heard
    something. `drive` travels to places if the program has no travel function. `stretch` returns
    the factor by which a local task takes longer than the mission says.
    """

    def __init__(
        self,
        group: anyio.abc.TaskGroup,
        program: RobotProgram,
        mission: Mission,
        identity: RobotIdentity,
        host: Host,
        *,
        drive: TaskFunction = drives_itself,
        stretch: Callable[[str], float] = lambda _: 1.0,
    ) -> None:
        self._drive = drive
        self._stretch = stretch
        # The task that the robot has travelled for and not begun, for its events.
        self._set_out: TaskContext | None = None
        self._group = group
        self._program = program
        self._functions = functions_of(program)
        self._mission = mission
        self._identity = identity
        self._host = host
        self.gate = StepGate(host.take_news, host.may_step)
        self._scopes: dict[int, anyio.CancelScope] = {}
        # Calls that run, with the ticket of their action; None if they belong to no action.
        self._calls: dict[UserCall, int | None] = {}
        # Calls still running long after their cancellation, as reported to the team.
        self._lingering: set[UserCall] = set()
        self._bid_calls: BidCalls | None = None
        # How many of the program's background functions run.
        self.backgrounds = 0
        self._are_times_old = asyncio.Event()

    def carry_out(self, effect: ProgramEffect) -> None:
        """Carry out an effect that concerns the program."""
        match effect:
            case StartAction(ticket):
                scope = self._scopes[ticket] = anyio.CancelScope()
                self._group.start_soon(self._run, effect, scope)
            case CancelAction(ticket):
                if ticket in self._scopes:
                    self._scopes[ticket].cancel()
                    loop = asyncio.get_running_loop()
                    loop.call_later(CANCEL_LIMIT_S, self._look_whether_stopped, ticket)
            case FeatureEffect():
                self._for_feature(effect)
            case UseMission(mission):
                self._use(mission)

    async def _check(self, mission: Mission) -> None:
        from mrbt_mesh.features.revisions.messages import MissionChecked

        own = mission.robots[self._identity.robot].capabilities
        problems = check_program(self._program, mission, own)
        text = f"its program does not fit: {'; '.join(problems)}" if problems else ""
        self._host.submit(MissionChecked(mission.digest, text))

    def _use(self, mission: Mission) -> None:
        """Use this mission for everything that begins from now on."""
        is_new_to_places = self._mission.travel is None and mission.travel is not None
        self._mission, known = mission, mission.robots.get(self._identity.robot)
        if known is not None:
            own = tuple(sorted(known.capabilities))
            self._identity = replace(self._identity, type=known.type, capabilities=own)
        if is_new_to_places:
            self._group.start_soon(self._publish_travel_times)
        self._are_times_old.set()

    def start_background(self) -> None:
        """Start the program's background functions and the evaluation of its travel times."""
        if self._mission.travel is not None:
            self._group.start_soon(self._publish_travel_times)
        for number, background in enumerate(self._functions.backgrounds):
            self.backgrounds += 1
            self._group.start_soon(self._background, background, f"background {number}")

    async def _run(self, effect: StartAction, scope: anyio.CancelScope) -> None:
        # A way has no result that could set conditions.
        ticket = None if effect.travel_to else effect.ticket
        port = self._port(ticket, self._job_of(effect))
        end: Input = ActionStopped(effect.ticket)
        with scope:
            end = await self._call(effect, port)
        port.close()
        del self._scopes[effect.ticket]
        self._host.submit(end)

    async def _call(self, effect: StartAction, port: AgentPort) -> ActionFinished:
        """Call the program's function. Any error in it is a failure of this local task."""
        name, arguments = split_call(effect.called["local_task"])
        stretch = self._stretch(effect.local_task)
        context = self._context(effect, name, arguments, port, stretch)
        place = effect.travel_to
        function = self._function(effect, name, port)
        what, given = f"local task {effect.called['local_task']}", arguments
        if place:
            function = self._functions.travel or self._drive
            what, given = f"way to {place}", (place,)
        error, reason, success = "", "", False
        if function is None:
            error = reason = f"the robot's program has no local task {name!r}"
        else:
            call = self._user_call(what, function, context, *given)
            scope = self._scopes.get(effect.ticket)
            if scope is not None and self._mission.stops_in_time:
                call.gate = partial(self.gate.pass_through, lambda: scope.cancel_called)
            first = self._first_event(context, place) if self._program.record_work else ""
            work = perform(call, context, port, first, place)
            try:
                success = await self._watched(call, work, effect.ticket)
                self._set_out = context if place and success and first else None
            except UserCodeError as failure:
                error, reason = failure.details, failure.reason
        conditions = tuple(sorted(port.conditions.items()))
        return ActionFinished(effect.ticket, success, conditions, error, reason)

    def _first_event(self, context: TaskContext, place: str) -> str:
        """Return the name of the first event: `begin` if the robot has already travelled for this
        task.
        """
        before, self._set_out = self._set_out, None
        if before is None:
            return "start"
        names = ("incarnation", "activation", "local_task")
        if not place and all(getattr(before, n) == getattr(context, n) for n in names):
            return "begin"
        _record(before, "cancel")  # it was assigned another task on arrival
        return "start"

    def _user_call(self, name: str, function: Callable[..., Any], *arguments: Any) -> UserCall:
        return UserCall(name, function, partial(function, *arguments), self._tell_problem)

    async def _watched(self, call: UserCall, run: Awaitable[_T], ticket: int | None = None) -> _T:
        """Await a call. What it raises while it is being cancelled is logged."""
        self._calls[call] = ticket
        try:
            return await run
        except anyio.get_cancelled_exc_class():
            if failure := call.late_failure:
                self._lingering.discard(call)
                self._tell_problem("when cancelled", call, failure)
            raise
        finally:
            del self._calls[call]
            if call in self._lingering:
                self._lingering.discard(call)
                self._host.log("info", "program_stopped", code=call.name)
                self._host.submit(ProblemFound(type_name(call.name), ""))

    def _function(self, effect: StartAction, name: str, port: AgentPort) -> TaskFunction | None:
        """Return the program's function for a local task.

        For a local task that is a tree in a file, it is a function that runs the tree.
        """
        found = program_tree(self._mission, effect.local_task)
        if found is None:
            return self._functions.local_task(name)
        values = dict(effect.values)
        ports = tuple((port, with_entries(text, values)) for port, text in found.ports)
        program = replace(found, ports=ports)

        async def run(context: TaskContext, *arguments: str) -> None:
            leaves, conditions = self._functions.leaves, self._mission.conditions
            await tree_format(program.source).run(
                program, leaves, conditions, context, port.report_tree
            )

        return run

    def _for_feature(self, effect: FeatureEffect) -> None:
        """Carry out what a feature asks of the program."""
        from mrbt_mesh.features.revisions.messages import CheckMission

        if isinstance(effect, CheckMission):
            self._group.start_soon(self._check, effect.mission)
            return
        # Loaded only for missions with bids.
        from mrbt_mesh.features.bids.messages import RequestBid
        from mrbt_mesh.runtime.bid_calls import BidCalls

        assert isinstance(effect, RequestBid)
        if self._bid_calls is None:
            self._bid_calls = BidCalls(
                self._group, self._host, self._functions.bid, self._call_about
            )
        self._bid_calls.answer(effect)

    async def _call_about(self, what: str, function: ProgramFunction, start: StartAction) -> Any:
        """Call a function of the program about a local task that the robot does not perform now."""
        name, arguments = split_call(start.local_task)
        context = self._context(start, name, arguments, self._port(None))
        call = self._user_call(what, function, context, *arguments)
        return await self._watched(call, call.run())

    # -- travel times -------------------------------------------------------------------------

    async def _publish_travel_times(self) -> None:
        """Evaluate and publish the travel times now, and again whenever the program asks for it."""
        function = self._functions.travel_time
        if function is None:
            # An earlier incarnation may have published some, with another program.
            self._host.submit(TravelTimesMade(NO_TRAVEL_TIMES))
            return
        while True:
            self._are_times_old.clear()
            times, problem = await self._travel_times(function)
            self._host.submit(TravelTimesMade(times))
            self._host.submit(ProblemFound("travel times", problem))
            await self._are_times_old.wait()

    async def _travel_times(self, function: ProgramFunction) -> tuple[TravelTimes, str]:
        """Return the times between all places that this robot may need, or none and the problem."""
        travel, robot, context = self._mission.travel, self._identity, self.robot_context()
        assert travel is not None
        kinds = self._mission.jobs.values()
        at = [*travel.at.items(), *(pair for kind in kinds for pair in kind.places())]
        goals = {goal for task, goal in at if context.can(task)}
        places = tuple(sorted(goals | {travel.start.get(robot.robot, "")} - {""}))
        if len(places) > MAX_TIMED_PLACES:
            most = f"at most {MAX_TIMED_PLACES} places of one robot"
            return NO_TRAVEL_TIMES, f"{most} are possible, not {len(places)}; all are as declared"
        now = ("", "")

        async def time_all() -> list[int | None]:
            nonlocal now
            found: list[int | None] = []
            for now in product(places, places):
                value = 0 if now[0] == now[1] else function(context, *now)
                value = await value if inspect.isawaitable(value) else value
                found.append(travel_ms(value, function))
                await anyio.lowlevel.checkpoint()
            return found

        call = UserCall("travel times", function, time_all, self._tell_problem)
        problem = f"not ready within {TRAVEL_TIMES_LIMIT_S:g} s"
        try:
            with anyio.move_on_after(TRAVEL_TIMES_LIMIT_S):
                found = await self._watched(call, call.run())
                count = len(places)
                rows = (tuple(found[row * count : (row + 1) * count]) for row in range(count))
                return TravelTimes(places, tuple(rows)), ""
        except UserCodeError as failure:
            problem = failure.reason
            self._host.log("error", "travel_times_failed", error=failure.details)
        way = f"from {now[0]} to {now[1]}"
        return NO_TRAVEL_TIMES, f"{way}: {problem}; all are as the mission declares"

    def _renew_travel_times(self) -> None:
        if self._functions.travel_time is None:
            raise ValueError("the program has no function @robot.travel_time")
        self._are_times_old.set()

    def _port(self, ticket: int | None, job: str = "") -> AgentPort:
        return AgentPort(self._host, self._mission, ticket, self._renew_travel_times, job)

    def _job_of(self, effect: StartAction) -> str:
        """Return the job whose blackboard entries the task reads and sets.

        Empty if there is none.
        """
        return parse_activation(effect.activation).job if self._mission.entries.has_values else ""

    def robot_context(self) -> RobotContext:
        """Return a context that belongs to no task."""
        return RobotContext(**self._robot(self._port(None)))

    async def _background(self, background: BackgroundFunction, source: str) -> None:
        name, function, context = background.name, background.function, self.robot_context()

        async def run() -> None:
            call = self._user_call(f"background function {name}", function, context)
            await self._watched(call, call.run())

        # A program may serve robots of several types.
        costs = tuple(each for each in background.costs if each == ALL or context.can(each))
        try:
            await BackgroundRunner(name, source, costs, run, self._host).run()
        finally:
            self.backgrounds -= 1

    def _tell_problem(self, what: str, call: UserCall, failure: UserCodeError) -> None:
        """Report a problem to the team, and log it with its traceback."""
        self._host.log("error", "program_failed", what=what, code=call.name, error=failure.details)
        self._host.submit(ProblemFound(type_name(call.name), f"{what}: {failure.reason}"))

    def _look_whether_stopped(self, ticket: int) -> None:
        """Report code that is still running long after it was cancelled."""
        for call, of in self._calls.items():
            if of == ticket:
                self._lingering.add(call)
                if call.waits_for:
                    reason = call.waits_for
                    self._host.log("warning", "cancelled_waits", code=call.name, reason=reason)
                    self._host.submit(ProblemFound(type_name(call.name), reason))
                    continue
                text = f"still runs {CANCEL_LIMIT_S:g} s after it was cancelled ({call.place()})"
                self._tell_problem("cancelled", call, UserCodeError(text))

    def abandon(self) -> None:
        """End all program code that shields itself from cancellation."""
        for call in list(self._calls):
            call.abandon()

    def _context(
        self,
        effect: StartAction,
        name: str,
        arguments: tuple[str, ...],
        port: AgentPort,
        stretch: float = 1.0,
    ) -> TaskContext:
        performance = effect.performance / MICRO
        work = self._mission.nominal_work(effect.local_task) / MICRO
        speed = self._identity.speed / stretch
        needed_s = work / (performance * speed) if performance else math.inf
        return TaskContext(
            **self._robot(port, work, needed_s),
            incarnation=str(effect.incarnation),
            activation=effect.activation,
            global_task=effect.called["global_task"],
            local_task=effect.called["local_task"],
            arguments=arguments,
            partners=effect.partners,
            performance=performance,
        )

    def _robot(self, port: AgentPort, work: float = 0.0, duration_s: float = 0.0) -> dict[str, Any]:
        """Return the fields that all contexts share."""
        robot = self._identity
        return {
            "robot": robot.robot,
            "robot_type": robot.type,
            "capabilities": robot.capabilities,
            "parameters": self._mission.parameters,
            "simulation": Simulation(robot.speed, robot.pid, robot.is_virtual, work, duration_s),
            "_port": port,
        }


async def perform(
    call: UserCall, task: TaskContext, port: AgentPort, first: str, place: str = ""
) -> bool:
    """Run the local task, or the way to `place` before it, and return True if it succeeded.

    `first` names its first event. That event and the end or cancellation of the whole task are
    written to the run's events; nothing is written if `first` is empty. Raises UserCodeError for
    whatever the function raised, and for an invalid result.
    """
    outcome = None
    if first:
        _record(task, first, place=place)
    try:
        success = _succeeded(await call.run(), call.function, port, bool(place))
        outcome = "success" if success else "failure"
    except UserCodeError:
        outcome = "failure"
        raise
    except Exception as error:  # the result cannot even be inspected
        outcome = "failure"
        raise failure_of(error, call.function) from None
    finally:
        if first and not (place and outcome == "success"):
            _record(task, "end" if outcome else "cancel", outcome)
    return success


def _succeeded(result: Any, function: Callable[..., Any], port: AgentPort, is_way: bool) -> bool:
    """Return the success that a result means, and set the conditions of a mapping.

    Raises UserCodeError.
    """
    if result is None:
        return True
    truth = truth_of(result)
    if truth is not None:
        return truth
    if isinstance(result, Mapping) and not is_way:
        try:
            port.set_conditions(result)
        except ValueError as error:
            raise wrong_result(function, result, str(error)) from None
        return True
    # NodeStatus and py_trees' Status: members of trees' leaves that became local tasks.
    ended = str(result.name) if isinstance(result, Enum) else ""
    if ended in ("SUCCESS", "FAILURE"):
        return ended == "SUCCESS"
    raise wrong_result(function, result, EXPECTED)


def _record(task: TaskContext, event: str, outcome: str | None = None, place: str = "") -> None:
    task.record_event(
        {
            "t": task.unix_time_s(),
            "robot": task.robot,
            "pid": task.simulation.pid,
            "incarnation": task.incarnation,
            "event": event,
            "outcome": outcome,
            "activation": task.activation,
            "global_task": task.global_task,
            "local_task": type_name(task.local_task),
            "args": list(task.arguments),
        }
        | ({"place": place} if place else {})
    )
