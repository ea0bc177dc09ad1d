"""A robot inside a user's own asyncio program: a ROS node, a driver, a web server.

    options = RobotOptions(keys=Path("keys"))
    async with mrbt_mesh.join_team("mission.yaml", "A1", robot, options) as member:
        await member.until(lambda: member.result is not None)

It shares the program's event loop and process. So it installs no signal handlers, configures no
log but its own, and ends nothing but itself: when it stops, the program goes on. A loop that is
blocked for longer than the detection time is like a stopped process: the robot fences itself off.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass, fields, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import anyio

from mrbt_mesh.core.agent.effects import Stop
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import Phase, TeamOrder
from mrbt_mesh.errors import InputError
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.context import RobotContext
from mrbt_mesh.runtime.driver import Driver, RobotSetup
from mrbt_mesh.runtime.fencing import selector_of
from mrbt_mesh.runtime.log import StandardLog
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.runtime.robot_options import RobotOptions
from mrbt_mesh.runtime.robot_process import claim_run_dir, robot_setup
from mrbt_mesh.runtime.settings import PROTOCOLS

if TYPE_CHECKING:
    from mrbt_mesh.core.agent.view import AgentView

File: TypeAlias = "str | PathLike[str]"
TREES = ("T_i", "T_A", "T_G", "T_Li")


class NotInTeamError(InputError):
    """The robot stopped before the awaited event; the message has the reason."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """A robot's work in the plan."""

    global_task: str
    local_task: str


class TeamMember:
    """A robot of a team, as seen from the program that hosts it.

    Its properties are what this robot knows now; `until` waits for changes.
    """

    def __init__(self, driver: Driver, running: asyncio.Task[Stop]) -> None:
        self._driver = driver
        self._running = running
        self._changed = anyio.Event()
        driver.on_step = self._step
        running.add_done_callback(self._step)

    def _step(self, _: object = None) -> None:
        self._changed.set()
        self._changed = anyio.Event()

    @property
    def _view(self) -> AgentView:
        return self._driver.view

    # -- to read ------------------------------------------------------------------------------

    @property
    def robot(self) -> str:
        """The robot's id."""
        return self._view.robot

    @property
    def has_joined(self) -> bool:
        """True once the robot has its place in the team."""
        return self._view.plan is not None and not self._view.is_joining

    @property
    def stopped(self) -> str | None:
        """Why the robot is no longer a member; None while it is one.

        The mission may be over, another robot may have taken its id, or its key was revoked.
        """
        if self._driver.stop is not None:
            return self._driver.stop.reason
        return "it broke" if self._running.done() else None

    @property
    def statuses(self) -> Mapping[str, str]:
        """The status of T_i, T_A, T_G and T_Li: idle, running, success or failure."""
        return {n: s.name.lower() for n, s in zip(TREES, self._view.statuses, strict=True)}

    @property
    def result(self) -> str | None:
        """The mission's result, success or failure; None while it runs."""
        plan = self._view.plan
        ended = plan is not None and plan.result in (Status.SUCCESS, Status.FAILURE)
        return plan.result.name.lower() if plan is not None and ended else None

    @property
    def command(self) -> str:
        """The operator's current command: resume, pause or abort."""
        return str(self._view.facts.order())

    @property
    def is_paused(self) -> bool:
        """Whether the operator has paused the team."""
        return self._view.facts.order() is TeamOrder.PAUSE

    @property
    def team(self) -> tuple[str, ...]:
        """The robots that this robot's plan counts on, itself included, sorted."""
        return tuple(sorted(self._view.alive()))

    @property
    def agrees(self) -> bool:
        """True if all robots have the same plan."""
        return self._view.agrees()

    @property
    def plan(self) -> Mapping[str, Assignment]:
        """Robot -> its assignment, sorted by robot. Robots without work are left out."""
        plan = self._view.plan
        lines = plan.assignments if plan is not None else {}
        return {r: Assignment(x.global_task, x.local_task) for r, x in sorted(lines.items())}

    @property
    def waiting(self) -> Mapping[str, str]:
        """Global task -> reason, for tasks that the tree requests and no robot performs."""
        plan = self._view.plan
        return {w.global_task: w.reason for w in plan.waiting} if plan is not None else {}

    @property
    def works_on(self) -> Assignment | None:
        """What the robot's program carries out now; None if nothing."""
        claim = self._view.claim
        if claim is None or claim.phase is not Phase.RUNNING:
            return None
        return Assignment(claim.global_task, claim.local_task)

    @property
    def context(self) -> RobotContext:
        """The context of this robot's background functions: conditions, capabilities, positions."""
        return self._driver.context()

    # -- to await -----------------------------------------------------------------------------

    async def changed(self) -> None:
        """Wait until the robot hears or does something, or stops."""
        await self._changed.wait()

    async def until(self, holds: Callable[[], bool]) -> None:
        """Wait until `holds()` is true; it is called after everything that the robot hears or does.

        Raises NotInTeamError if the robot has stopped and `holds()` is false.
        """
        while not holds():
            if self.stopped is not None:
                raise NotInTeamError(f"{self.robot} is not a member any more: {self.stopped}")
            await self._changed.wait()

    async def until_joined(self) -> None:
        """Wait until the robot has its place in the team.

        Raises NotInTeamError if it is refused.
        """
        await self.until(lambda: self.has_joined)

    async def until_ended(self) -> str:
        """Wait for the mission's result, success or failure.

        In an endless mission, it is the result of a round. Raises NotInTeamError if the robot stops
        before.
        """
        await self.until(lambda: self.result is not None)
        return str(self.result)

    async def leave(self) -> None:
        """Hand over the work and leave the team, within three seconds."""
        if self.stopped is None:
            await self._driver.leave()
        self._step()


@asynccontextmanager
async def join_team(
    mission: File,
    robot: str,
    program: RobotProgram | str | None = None,
    options: RobotOptions | None = None,
) -> AsyncIterator[TeamMember]:
    """Take part in a team as a robot while the body runs; leave it however the body ends.

    `mission` is a mission file, or a compiled one. `program` is a program or a reference to one
    (`robot.py:name`); None means the mission's. One of the `options` is required: `keys`, a folder
    made by `mrbt keys`, or `insecure=True`. It needs asyncio's event loop, possibly under anyio.

    Raises InputError before the body if any of these is wrong. An exception in the robot's program
    ends a local task, not the body.
    """
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        raise InputError("join_team needs asyncio: no event loop of it runs here") from None
    selector_of(loop)  # called here, so that the traceback does not mention tasks that have begun
    driver = Driver(
        _setup(Path(fspath(mission)), robot, program, _checked(options or RobotOptions()))
    )
    running = loop.create_task(driver.run_as_guest(), name=f"mrbt robot {robot}")
    member = TeamMember(driver, running)
    try:
        await _begun(driver, running)
        yield member
    finally:
        with anyio.CancelScope(shield=True):
            await _ended(driver, member, running)


def _setup(
    file: Path, robot: str, program: RobotProgram | str | None, options: RobotOptions
) -> RobotSetup:
    """Return the setup of the robot that is to join. Raises InputError."""
    mission = load_mission(file)
    reference = "the program"
    if not isinstance(program, RobotProgram):
        found = program or options.program or mission.program
        if found is None:
            raise InputError(f"mission {mission.name} names no program: give one to join_team")
        reference, program = found, load_program(found)
    if options.run_dir is not None:
        try:
            claim_run_dir(options.run_dir, robot, options.takeover)
        except OSError as error:
            raise InputError(f"{options.run_dir}: cannot be written: {error.strerror}") from None
    return robot_setup(mission, robot, options, program, reference, StandardLog(robot))


def _is_number(least: float, most: float) -> Callable[[Any], bool]:
    return lambda value: type(value) in (int, float) and least <= value <= most


def _is_list(value: Any) -> bool:
    is_list = isinstance(value, Sequence) and not isinstance(value, str)
    return is_list and all(isinstance(each, str) for each in value)


_LIST = ("a list of texts", _is_list)
_TEXT = ("a text", lambda value: isinstance(value, str))
_FLAG = ("True or False", lambda value: isinstance(value, bool))
_PATH = ("a path", lambda value: isinstance(value, str | PathLike))
_PERIOD = ("a number of seconds from 0.001 to 3600", _is_number(0.001, 3_600))
# The allowed values of options, besides their defaults.
_EXPECTED: Mapping[str, tuple[str, Callable[[Any], bool]]] = {
    **dict.fromkeys(("type", "team", "run", "multicast", "program", "solver"), _TEXT),
    **dict.fromkeys(("listen", "connect", "routers", "expect"), _LIST),
    **dict.fromkeys(("insecure", "alone", "takeover", "exit_when_done", "record_beats"), _FLAG),
    **dict.fromkeys(("keys", "run_dir", "record"), _PATH),
    **dict.fromkeys(("beat_s", "detection_s"), _PERIOD),
    **dict.fromkeys(
        ("gather_s", "alone_after_s"),
        ("a number of seconds from 0 to 86400", _is_number(0, 86_400)),
    ),
    "speed": ("a number from 0.01 to 1000", _is_number(0.01, 1_000)),
    "keep_mib": ("a number of MiB from 1 to 1000000", _is_number(1, 1_000_000)),
    "transport": (" or ".join(map(repr, PROTOCOLS)), lambda value: value in tuple(PROTOCOLS)),
    **dict.fromkeys(
        ("while_locked", "metrics_port", "metrics_host"),
        ("None here (robots with a process of their own have it)", lambda _: False),
    ),
}


def _checked(options: RobotOptions) -> RobotOptions:
    """Return the options, with texts converted to paths. Raises InputError for a wrong value."""
    for each in fields(options):
        value = getattr(options, each.name)
        expected, accepts = _EXPECTED[each.name]
        is_default = value == each.default and type(value) is type(each.default)
        if not is_default and not accepts(value):
            raise InputError(f"join_team: {each.name} is {expected}, not {value!r:.80}")
    if options.insecure is (options.keys is not None):
        text = "give either keys=FOLDER, made by `mrbt keys`, or insecure=True"
        raise InputError(f"join_team: {text}")
    paths = {name: getattr(options, name) for name in ("keys", "run_dir", "record")}
    found: dict[str, Any] = {n: Path(fspath(p)) for n, p in paths.items() if p is not None}
    return replace(options, **found)


async def _begun(driver: Driver, running: asyncio.Task[Stop]) -> None:
    """Wait until the robot hears its team; raises what the robot raised instead."""
    begun = asyncio.ensure_future(driver.begun.wait())
    try:
        await asyncio.wait((begun, running), return_when=asyncio.FIRST_COMPLETED)
    finally:
        begun.cancel()
    if running.done():
        running.result()


async def _ended(driver: Driver, member: TeamMember, running: asyncio.Task[Stop]) -> None:
    """Leave the team, even if the body was cancelled.

    Raises what broke the robot, if anything did.
    """
    if not driver.begun.is_set():
        running.cancel()
    elif not running.done():
        await member.leave()
    with contextlib.suppress(asyncio.CancelledError):
        await running
