"""Runs a robot's program for the agent: starts and cancels actions, hands back how they ended.

Used by the real runtime and, on a virtual clock, by the simulator.
"""

from __future__ import annotations

import inspect
import math
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import anyio
import anyio.abc
import anyio.lowlevel

from mrbt_mesh.core.agent.effects import CancelAction, RequestBid, StartAction
from mrbt_mesh.core.agent.inputs import (
    ActionFinished,
    ActionStopped,
    BidMade,
    BidsMade,
    CapabilityChanged,
    ConditionSet,
    Input,
    PerformanceChanged,
    PositionReported,
    ProgressReported,
    TreeTicked,
)
from mrbt_mesh.core.bt.local_run import OwnConditions
from mrbt_mesh.core.bt.tree import Tree
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.wire import MAX_COORDINATE, Position
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON, one_line
from mrbt_mesh.core.mission.mission import (
    MAX_BID_WITHIN_US,
    MAX_PERFORMANCE,
    MICRO,
    Mission,
    micro_performance,
)
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.errors import TaskFailedError
from mrbt_mesh.runtime.local_trees import LeafEnd, LocalTreeRunner
from mrbt_mesh.runtime.program import RobotProgram, TaskContext, TaskFunction

MAX_ERROR = 2_000
# No mission waits longer for a bid.
BID_LIMIT_S = MAX_BID_WITHIN_US / MICRO


class Host(Protocol):
    """What an action needs of its surroundings."""

    def submit(self, event: Input) -> None:
        """Hand an input to the agent; may be called from the event loop only."""
        ...

    def read_condition(self, name: str) -> bool: ...
    def record_event(self, event: Mapping[str, Any]) -> None: ...
    def unix_time_s(self) -> float: ...
    def log(self, level: str, event: str, **fields: Any) -> None: ...


@dataclass(frozen=True)
class RobotIdentity:
    """The robot on which a program runs, as its contexts show it."""

    robot: str
    type: str
    pid: int
    speed: float
    is_virtual: bool = False


class _NoBidError(Exception):
    """Why there is no bid; the message says all that is to be said."""


def micro_bid(value: Any) -> int | None:
    """A bid in micro-units, None for none. Raises _NoBidError for what is no bid."""
    most = MAX_PERFORMANCE // MICRO
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not -most <= value <= most:
        raise _NoBidError(f"a bid is a number from {-most} to {most}, or None, not {value!r:.80}")
    return round(value * MICRO)


def milli_position(x: float, y: float, heading: float | None) -> Position:
    """A position in thousandths, the heading turned into one turn. Raises ValueError."""
    most = MAX_COORDINATE // 1_000
    for number in (x, y, heading or 0.0):
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ValueError(f"a position is of numbers, not {number!r:.80}")
        if not -most <= number <= most:
            raise ValueError(f"a position is of numbers from {-most} to {most}, not {number!r}")
    turned = None if heading is None else round(math.remainder(heading, math.tau) * 1_000)
    return Position(round(x * 1_000), round(y * 1_000), turned)


def _exception_reason(error: Exception, function: TaskFunction) -> str:
    """What was raised, and where in the robot's program: `KeyError: 'grip' (robot.py:12)`."""
    text = "".join(traceback.format_exception_only(error)).strip()
    frames = traceback.extract_tb(error.__traceback__)[1:]
    code = getattr(inspect.unwrap(function), "__code__", None)
    folder = Path(code.co_filename).parent if code is not None else None
    own = [frame for frame in frames if Path(frame.filename).parent == folder]
    if not frames:
        return text
    place = (own or frames)[-1]
    where = f" ({Path(place.filename).name}:{place.lineno})"
    return one_line(text[: MAX_REASON - len(where)]) + where


class _Port:
    """Behind one TaskContext; collects the conditions that go with the outcome.

    `own` are the robot's own conditions. `whole` is the port of the local task in whose tree this
    one's action stands.
    """

    def __init__(
        self,
        host: Host,
        mission: Mission,
        ticket: int | None,
        own: OwnConditions,
        whole: _Port | None = None,
    ) -> None:
        self._host = host
        self._mission = mission
        self._ticket = ticket
        self._own = own
        self._whole = whole
        self.conditions: dict[str, bool] = {}
        self.own_conditions: dict[str, bool] = {}
        self._tree_statuses = b""

    def set_condition(self, name: str, value: bool, at_once: bool) -> None:
        if not self._mission.knows_condition(name):
            declared = ", ".join(sorted(self._mission.conditions)) or "none"
            raise ValueError(f"condition {name!r} is not declared in the mission ({declared})")
        if self._mission.is_failure_reason(name):
            text = "tells why something failed: fail with such a reason instead"
            raise ValueError(f"condition {name!r} {text}")
        if at_once or self._ticket is None:
            self._host.submit(ConditionSet(name, bool(value)))
        else:
            self.conditions[name] = bool(value)

    def read_condition(self, name: str) -> bool:
        known = self._whole.read_condition if self._whole is not None else self._host.read_condition
        return self.conditions.get(name, known(name))

    def set_local_condition(self, name: str, value: bool, at_once: bool) -> None:
        if not self._mission.knows_local_condition(name):
            declared = ", ".join(sorted(self._mission.local_conditions)) or "none"
            raise ValueError(f"{name!r} is not declared in local_conditions ({declared})")
        if at_once or self._ticket is None:
            self._own.set(name, bool(value))
        else:
            self.own_conditions[name] = bool(value)

    def read_local_condition(self, name: str) -> bool:
        return self.own_conditions.get(name, self._own.value(name))

    def report_progress(self, fraction: float) -> None:
        if self._ticket is not None:
            percent = max(0, min(100, round(fraction * 100)))
            self._host.submit(ProgressReported(self._ticket, percent))

    def report_tree(self, statuses: bytes) -> None:
        """The tree that is the action has been ticked: the statuses of its nodes in preorder."""
        if self._ticket is not None and statuses != self._tree_statuses:
            self._tree_statuses = statuses
            self._host.submit(TreeTicked(self._ticket, statuses))

    def report_position(self, x: float, y: float, heading: float | None) -> None:
        self._host.submit(PositionReported(milli_position(x, y, heading)))

    def lose_capability(self, local_task: str) -> None:
        self._host.submit(CapabilityChanged(local_task, lost=True))

    def restore_capability(self, local_task: str) -> None:
        self._host.submit(CapabilityChanged(local_task, lost=False))

    def report_performance(self, local_task: str, performance: float) -> None:
        self._host.submit(PerformanceChanged(local_task, micro_performance(performance)))

    def record_event(self, event: Mapping[str, Any]) -> None:
        self._host.record_event(event)

    def unix_time_s(self) -> float:
        return self._host.unix_time_s()


class ActionRunner:
    """Runs actions and bids as tasks of `group`; each ends in exactly one input to the host, bids
    that end at the same time in a common one.
    """

    def __init__(
        self,
        group: anyio.abc.TaskGroup,
        program: RobotProgram,
        mission: Mission,
        identity: RobotIdentity,
        host: Host,
    ) -> None:
        self._group = group
        self._program = program
        self._mission = mission
        self._identity = identity
        self._host = host
        self._scopes: dict[int, anyio.CancelScope] = {}
        self._bids: list[BidMade] = []
        self._own = OwnConditions(mission.local_condition_default)
        # How many of the program's sensors run.
        self.backgrounds = 0

    def carry_out(self, effect: StartAction | CancelAction | RequestBid) -> None:
        """Do what the agent wants of the program."""
        match effect:
            case StartAction(ticket):
                scope = self._scopes[ticket] = anyio.CancelScope()
                self._group.start_soon(self._run, effect, scope)
            case CancelAction(ticket):
                if ticket in self._scopes:
                    self._scopes[ticket].cancel()
            case RequestBid():
                self._group.start_soon(self._bid, effect)

    def start_background(self) -> None:
        """Start the program's sensors."""
        for function in self._program.backgrounds:
            self.backgrounds += 1
            self._group.start_soon(self._background, function)

    async def _run(self, effect: StartAction, scope: anyio.CancelScope) -> None:
        port = _Port(self._host, self._mission, effect.ticket, self._own)
        tree = self._mission.local_trees.get(effect.local_task)
        end: Input = ActionStopped(effect.ticket)
        with scope:
            if tree is None:
                end = await self._call(effect, port)
                for name, value in port.own_conditions.items():
                    self._own.set(name, value)
            else:
                end = await self._run_tree(effect, tree, port)
        del self._scopes[effect.ticket]
        self._host.submit(end)

    async def _run_tree(self, effect: StartAction, tree: Tree, port: _Port) -> ActionFinished:
        """Carry out a local task that is a tree; its status is the outcome.

        Conditions of the team and data of its actions go with that outcome; where it fails, so does
        the reason of the action that failed last. What made actions fail is logged when it happens.
        """
        data: dict[str, Any] = {}
        reason = ""

        async def run_leaf(local_task: str) -> LeafEnd:
            nonlocal reason
            inner = _Port(self._host, self._mission, effect.ticket, self._own, port)
            end = await self._call(replace(effect, local_task=local_task), inner)
            port.conditions |= inner.conditions
            data.update(end.data or {})
            reason = reason if end.success else end.reason
            level, outcome = ("info", "success") if end.success else ("warning", "failure")
            self._host.log(
                level,
                "local_tree_action_finished",
                local_task=effect.local_task,
                action=local_task,
                outcome=outcome,
                error=end.error,
            )
            return end.success, inner.own_conditions

        runner = LocalTreeRunner(self._group, tree, self._own, run_leaf, port.report_tree)
        success = await runner.run()
        conditions = tuple(sorted(port.conditions.items()))
        reason = "" if success else reason
        return ActionFinished(effect.ticket, success, data or None, conditions, reason=reason)

    async def _call(self, effect: StartAction, port: _Port) -> ActionFinished:
        """Call the user's function; whatever it raises is a failure of this local task."""
        ticket, (name, arguments) = effect.ticket, split_call(effect.local_task)
        context = self._context(effect, name, arguments, port)
        function = self._function(effect.local_task, name, port)
        error, reason, data, success = "", "", None, False
        if function is None:
            error = reason = f"the robot's program has no local task {name!r}"
        else:
            try:
                result = await function(context, *arguments)
                success = result is not False
                data = dict(result) if isinstance(result, Mapping) else None
            except TaskFailedError as failure:
                error, reason = str(failure) or "failed", str(failure)
            except Exception as problem:
                error = traceback.format_exc(limit=-8)[-MAX_ERROR:]
                reason = _exception_reason(problem, function)
        conditions = tuple(sorted(port.conditions.items()))
        return ActionFinished(ticket, success, data, conditions, error, reason)

    def _function(self, ground: str, name: str, port: _Port) -> TaskFunction | None:
        """The program's function for a local task; of one that is a tree in a file, its run."""
        program = self._mission.program_trees.get(ground)
        if program is None:
            return self._program.find(name)
        from mrbt_mesh.runtime.team_leaves import team_leaves
        from mrbt_mesh.runtime.tree_programs import carry_out, made_tree, told_outputs

        async def run(context: TaskContext, *arguments: str) -> None:
            leaves = team_leaves(self._program.leaves, self._mission.conditions)
            tree = made_tree(program, leaves, {TaskContext: context})
            try:
                await carry_out(tree, {}, port.report_tree)
            finally:
                for condition, value in told_outputs(program, tree).items():
                    context.set_condition(condition, value)

        return self._program.recording(run)

    async def _bid(self, effect: RequestBid) -> None:
        value, error = None, ""
        try:
            with anyio.move_on_after(BID_LIMIT_S) as scope:
                value = micro_bid(await self._call_bid(effect))
            if scope.cancelled_caught:
                error = f"no answer within {BID_LIMIT_S:g} s"
        except _NoBidError as problem:
            error = str(problem)
        except Exception:
            error = traceback.format_exc(limit=-8)[-MAX_ERROR:]
        self._bids.append(BidMade(effect.activation, effect.local_task, value, error))
        if len(self._bids) == 1:
            self._group.start_soon(self._tell_bids)

    async def _tell_bids(self) -> None:
        # Those that are about to end come along: one message tells them all.
        await anyio.lowlevel.checkpoint()
        bids, self._bids = tuple(self._bids), []
        self._host.submit(BidsMade(bids))

    async def _call_bid(self, effect: RequestBid) -> Any:
        name, arguments = split_call(effect.local_task)
        function = self._program.find_bid(name)
        if function is None:
            raise _NoBidError(f"the robot's program has no bid for {name!r}")
        port = _Port(self._host, self._mission, None, self._own)
        start = StartAction(
            0,
            effect.activation,
            effect.global_task,
            effect.local_task,
            (),
            effect.performance,
            effect.incarnation,
        )
        result = function(self._context(start, name, arguments, port), *arguments)
        return await result if inspect.isawaitable(result) else result

    def free_context(self) -> TaskContext:
        """A context that belongs to no activation."""
        port = _Port(self._host, self._mission, None, self._own)
        effect = StartAction(0, "", "", "", (), MICRO, Incarnation(0, ""))
        return self._context(effect, "", (), port)

    async def _background(self, function: Callable[[TaskContext], Any]) -> None:
        try:
            await function(self.free_context())
        except Exception:
            name = getattr(function, "__name__", repr(function))
            text = traceback.format_exc(limit=-8)[-MAX_ERROR:]
            self._host.log("error", "background_failed", function=name, error=text)
        finally:
            self.backgrounds -= 1

    def _context(
        self, effect: StartAction, name: str, arguments: tuple[str, ...], port: _Port
    ) -> TaskContext:
        return TaskContext(
            robot=self._identity.robot,
            robot_type=self._identity.type,
            incarnation=str(effect.incarnation),
            pid=self._identity.pid,
            activation=effect.activation,
            global_task=effect.global_task,
            local_task=effect.local_task,
            arguments=arguments,
            partners=effect.partners,
            performance=effect.performance / MICRO,
            work=self._mission.nominal_work(effect.local_task) / MICRO,
            speed=self._identity.speed,
            parameters=self._mission.parameters,
            port=port,
            is_virtual=self._identity.is_virtual,
        )
