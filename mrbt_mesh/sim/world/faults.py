"""The faults that there are in the simulator: a schedule is a list of (at_us, fault).

Times count from the launch of the team, in microseconds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

from mrbt_mesh.sim.world.network import Link, LinkKnobs


@dataclass(frozen=True, slots=True)
class Kill:
    """SIGKILL: the process is gone, and what it had not written to its journal yet."""

    robot: str


@dataclass(frozen=True, slots=True)
class KillAfter:
    """SIGKILL right after the robot has told the team how its `actions`-th action from now ended.

    Actions that were cancelled do not count. Raises ValueError if `actions` is below 1.
    """

    robot: str
    actions: int

    def __post_init__(self) -> None:
        if self.actions < 1:
            raise ValueError(f"actions: at least 1 is expected, found {self.actions}")


@dataclass(frozen=True, slots=True)
class Restart:
    """Start a new process of this robot: one that died or left, or that was not there before.

    A process that still runs is killed first. `keeps_journal`: it finds what it had written.
    """

    robot: str
    keeps_journal: bool = True


@dataclass(frozen=True, slots=True)
class Disk:
    """From now on the robot's disk takes `sync_us` for a sync.

    `fails`: nothing can be written, as when it is full; `is_locked`: the journal cannot be read
    either, which a process that starts then has to go without. With the defaults it works again.
    """

    robot: str
    sync_us: int = 0
    fails: bool = False
    is_locked: bool = False


@dataclass(frozen=True, slots=True)
class Freeze:
    """SIGSTOP: nothing of the process runs, its messages wait, its token stays."""

    robot: str


@dataclass(frozen=True, slots=True)
class Suspend:
    """Its computer sleeps: as `Freeze`, but its waits stand still too; `Thaw` wakes it."""

    robot: str


@dataclass(frozen=True, slots=True)
class Thaw:
    """SIGCONT, or the end of a suspend."""

    robot: str


@dataclass(frozen=True, slots=True)
class Leave:
    """The robot leaves on purpose."""

    robot: str


@dataclass(frozen=True, slots=True)
class Lose:
    """A minor fault: the robot loses a local task (a type, a ground one, or `all`)."""

    robot: str
    local_task: str
    reason: str = "injected"


@dataclass(frozen=True, slots=True)
class Restore:
    """The end of a minor fault."""

    robot: str
    local_task: str = "all"


@dataclass(frozen=True, slots=True)
class ChangePerformance:
    """From now on the robot does a local task (a type or a ground one) so well, in micro-units.

    0 is a minor fault.
    """

    robot: str
    local_task: str
    performance: int


@dataclass(frozen=True, slots=True)
class Block:
    """Nothing passes over these links, each in one direction."""

    links: frozenset[Link]


@dataclass(frozen=True, slots=True)
class Unblock:
    """Messages pass again; None: on all links."""

    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Slow:
    """The robot's event loop comes round every `lag_us` only; 0: it is fast again."""

    robot: str
    lag_us: int


@dataclass(frozen=True, slots=True)
class ClockRate:
    """The robot's clocks run faster by `rate_ppm` parts in a million, or slower below 0."""

    robot: str
    rate_ppm: int


@dataclass(frozen=True, slots=True)
class ClockJump:
    """The robot's boot-time clock jumps ahead, as when a virtual machine is resumed."""

    robot: str
    ahead_us: int


@dataclass(frozen=True, slots=True)
class Disturb:
    """Links behave otherwise from now on: loss, delay, doubling; None: all links."""

    link: LinkKnobs
    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Settle:
    """Links behave as usual again; None: all links."""

    links: frozenset[Link] | None = None


@dataclass(frozen=True, slots=True)
class Replay:
    """The last `count` messages that `source` had published by `until_us` reach `robot` again."""

    robot: str
    source: str
    until_us: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class Heal:
    """All faults end: links, disks, frozen and slow robots, clocks, lost capabilities, a pause.

    `robots` that do not run are started again, with what their journals kept. `broken` are links
    that from now on stay so.
    """

    robots: tuple[str, ...] = ()
    broken: frozenset[Link] = frozenset()


@dataclass(frozen=True, slots=True)
class LoseToken:
    """A liveliness token lies: `seen_by` sees `robot`'s go although the robot lives."""

    robot: str
    seen_by: str


@dataclass(frozen=True, slots=True)
class EndRouter:
    """A router dies (`NetworkKnobs.routers`): its clients are without a link for a moment."""

    router: str


@dataclass(frozen=True, slots=True)
class StartRouter:
    """A router is there again; who has found another one stays with that."""

    router: str


@dataclass(frozen=True, slots=True)
class Garbage:
    """`robot` receives `count` malformed, foreign or forged messages of all kinds."""

    robot: str
    count: int = 10


@dataclass(frozen=True, slots=True)
class Command:
    """An operator's command arrives at `robot`, as `mrbt fault` and the like send it."""

    robot: str
    command: str
    argument: str = ""


Fault: TypeAlias = (
    Kill
    | KillAfter
    | Restart
    | Disk
    | Freeze
    | Suspend
    | Thaw
    | Slow
    | ClockRate
    | ClockJump
    | Leave
    | Lose
    | Restore
    | ChangePerformance
    | Block
    | Unblock
    | Disturb
    | Settle
    | Replay
    | Heal
    | LoseToken
    | EndRouter
    | StartRouter
    | Garbage
    | Command
)
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
        values.append(str(value))
    return " ".join([type(fault).__name__, *values])
