"""The faults of the simulator; a schedule is a list of (at_us, fault).

Times count from the launch of the team, in microseconds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import product
from typing import Any, TypeAlias

from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.sim.world.network import Link, LinkKnobs


@dataclass(frozen=True, slots=True)
class Fault:
    """Something that goes wrong, or its end."""


@dataclass(frozen=True, slots=True)
class RobotFault(Fault):
    """A fault of one robot."""

    robot: str


@dataclass(frozen=True, slots=True)
class Kill(RobotFault):
    """SIGKILL: the process ends, and what was not in its journal yet is lost."""


@dataclass(frozen=True, slots=True)
class KillAfter(RobotFault):
    """SIGKILL right after the robot has reported the end of its `actions`-th action from now.

    Actions that were cancelled do not count. Raises ValueError if `actions` is below 1.
    """

    actions: int

    def __post_init__(self) -> None:
        if self.actions < 1:
            raise ValueError(f"actions: at least 1 is expected, found {self.actions}")


@dataclass(frozen=True, slots=True)
class Restart(RobotFault):
    """Start a new process of this robot: one that died or left, or that was not there before.

    A process that still runs is killed first. `keeps_journal`: it finds what it had written.
    """

    keeps_journal: bool = True


@dataclass(frozen=True, slots=True)
class Disk(RobotFault):
    """From now on the robot's disk takes `sync_us` for a sync.

    `fails`: nothing can be written, as when it is full; `is_locked`: the journal cannot be read
    either, and a process that starts then begins without it. The defaults: it works again.
    """

    sync_us: int = 0
    fails: bool = False
    is_locked: bool = False


@dataclass(frozen=True, slots=True)
class Freeze(RobotFault):
    """SIGSTOP: nothing of the process runs, its messages wait, its token stays."""


@dataclass(frozen=True, slots=True)
class Suspend(RobotFault):
    """Its computer sleeps: as `Freeze`, but its timers stop too; `Thaw` wakes it."""


@dataclass(frozen=True, slots=True)
class Pause(RobotFault):
    """Its machine is paused with all its clocks, as a virtual machine is for a snapshot; `Thaw`
    lets it go on.
    """


@dataclass(frozen=True, slots=True)
class Thaw(RobotFault):
    """SIGCONT, or the end of a suspend or a pause."""


@dataclass(frozen=True, slots=True)
class Leave(RobotFault):
    """The robot leaves on purpose."""


@dataclass(frozen=True, slots=True)
class Lose(RobotFault):
    """A minor fault: the robot loses a local task (a type, a ground one, or `all`)."""

    local_task: str
    reason: str = "injected"


@dataclass(frozen=True, slots=True)
class Revise(RobotFault):
    """An operator proposes to the robot that the team takes up this mission, compiled."""

    mission: str = field(repr=False)
    is_forced: bool = False
    repeats_exclusive: bool = False


@dataclass(frozen=True, slots=True)
class Restore(RobotFault):
    """The end of a minor fault."""

    local_task: str = "all"


@dataclass(frozen=True, slots=True)
class ChangePerformance(RobotFault):
    """A robot's performance at a local task (a type or a ground one) from now on.

    In micro-units; 0 is a minor fault.
    """

    local_task: str
    performance: int


@dataclass(frozen=True, slots=True)
class Block(Fault):
    """Nothing passes over these links, each in one direction."""

    links: frozenset[Link]


@dataclass(frozen=True, slots=True)
class Unblock(Fault):
    """Messages pass again; None: on all links."""

    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Slow(RobotFault):
    """The robot's event loop runs only every `lag_us`; 0: it is fast again."""

    lag_us: int


@dataclass(frozen=True, slots=True)
class ClockRate(RobotFault):
    """The robot's clocks run faster by `rate_ppm` parts in a million, or slower below 0."""

    rate_ppm: int


@dataclass(frozen=True, slots=True)
class ClockJump(RobotFault):
    """The robot's boot-time clock jumps ahead, as when a virtual machine is resumed."""

    ahead_us: int


@dataclass(frozen=True, slots=True)
class SetWallClock(RobotFault):
    """The robot's wall clock is `ahead_us` ahead of the true time (behind it below 0) from now on,
    and runs faster by `drift_ppm` parts in a million.
    """

    ahead_us: int
    drift_ppm: int = 0


@dataclass(frozen=True, slots=True)
class Disturb(Fault):
    """Links behave otherwise from now on: loss, delay, doubling; None: all links."""

    link: LinkKnobs
    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Settle(Fault):
    """Links behave as usual again; None: all links."""

    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Replay(RobotFault):
    """The last `count` messages that `source` had published by `until_us` reach `robot` again."""

    source: str
    until_us: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class Heal(Fault):
    """All faults end: links, disks, frozen and slow robots, clocks, lost capabilities, a pause.

    `robots` that do not run are started again, with what their journals kept. `broken` are links
    that from now on stay so.
    """

    robots: tuple[str, ...] = ()
    broken: frozenset[Link] = frozenset()


@dataclass(frozen=True, slots=True)
class LoseToken(RobotFault):
    """`seen_by` loses sight of `robot`'s liveliness token although the robot lives."""

    seen_by: str


@dataclass(frozen=True, slots=True)
class EndRouter(Fault):
    """A router dies (`NetworkKnobs.routers`): its clients are without a link for a moment."""

    router: str


@dataclass(frozen=True, slots=True)
class StartRouter(Fault):
    """A router is back; clients of other routers stay where they are."""

    router: str


@dataclass(frozen=True, slots=True)
class Garbage(RobotFault):
    """`robot` receives `count` malformed, foreign or forged messages of all kinds."""

    count: int = 10


@dataclass(frozen=True, slots=True)
class Command(RobotFault):
    """An operator's word arrives at `robot`, as `mrbt fault` and the like send it."""

    command: str
    argument: str = ""


@dataclass(frozen=True, slots=True)
class Operate(RobotFault):
    """A client that has seen what `robot` has seen commands `name` (a field and its subject) at it,
    and at `also` at the same time. `value`: plain data.
    """

    name: str
    value: Any
    operator: str = "op"
    also: tuple[str, ...] = ()


Schedule: TypeAlias = Iterable[tuple[int, Fault]]


def partition(*groups: Iterable[str]) -> Block:
    """Cut the team into groups that do not hear one another."""
    sets = [frozenset(group) for group in groups]
    pairs = ((one, other) for one in sets for other in sets if one is not other)
    return Block(frozenset(link for pair in pairs for link in product(*pair)))


def fault_text(fault: Fault) -> str:
    """A fault in one word and its values, in a fixed order: `Kill A1`."""
    values = []
    for name in fault.__dataclass_fields__:
        value = getattr(fault, name)
        if isinstance(value, frozenset):
            value = ",".join(f"{source}>{target}" for source, target in sorted(value))
        if name == "mission":
            text = value if isinstance(value, str) else compile_mission(value)
            value = hashlib.blake2b(text.encode(), digest_size=4).hexdigest()
        values.append(str(value))
    return " ".join([type(fault).__name__, *values])
