"""The effects of an agent: plain data, no behaviour."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import with_entries
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.core.scheduling.dispatch import Dispatched


@dataclass(frozen=True, slots=True)
class Publish:
    """Send to these robots and to observers; `to` is None: to everybody."""

    kind: MessageKind
    data: bytes
    to: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Persist:
    """Keep these entries in the journal: `at_once`, or a little later, with others.

    Unless `number` is 0 it is answered by JournalSynced, once these and all before are on disk.
    """

    entries: tuple[Entry, ...]
    at_once: bool
    number: int = 0


@dataclass(frozen=True, slots=True)
class Forget:
    """These entries, by author and name, can no longer be reached: the journal may drop them."""

    keys: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Ask:
    """Send a PULL to one peer; its answer comes back as AnswerReceived."""

    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class AskRouter:
    """Ask a router whether it or another one has a link to this robot.

    It is answered by RouterAnswered.
    """

    robot: str
    incarnation: Incarnation
    router: str


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer a query, with one message or, for a PULL of many facts, several pages."""

    query: int
    pages: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class StartAction:
    """Run a local task; ends with ActionFinished or, after CancelAction, ActionStopped.

    `coalition` is the token of the coalition that it starts with, empty without one. `travel_to`:
    it is only the way to this place, where the local task happens; empty: the local task itself.
    `values`: blackboard entry -> its value, of those that are arguments.
    """

    ticket: int
    activation: str
    global_task: str
    local_task: str
    partners: tuple[str, ...]
    performance: int
    incarnation: Incarnation
    coalition: str = ""
    travel_to: str = ""
    values: tuple[tuple[str, str], ...] = ()

    @property
    def called(self) -> dict[str, str]:
        """The tasks with these values as arguments, as programs and people see them."""
        names = {"global_task": self.global_task, "local_task": self.local_task}
        values = dict(self.values)
        return {key: with_entries(n, values) for key, n in names.items()} if values else names


@dataclass(frozen=True, slots=True)
class MakePlan:
    """Call `make`, in another thread if there is one; answered by PlanMade of the same number."""

    number: int
    make: Callable[[], Plan] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class SearchSchedule:
    """Carry out these steps beside all else; the last one is answered by ScheduleFound of this
    number.
    """

    number: int
    steps: Iterator[Dispatched] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class CheckMission:
    """See whether the robot's program can do what a revision of the mission asks of this robot;
    answered by MissionChecked.
    """

    mission: Mission = field(repr=False)


@dataclass(frozen=True, slots=True)
class UseMission:
    """This revision of the mission is in force: what is begun from now on is of it."""

    mission: Mission = field(repr=False)


@dataclass(frozen=True, slots=True)
class CancelAction:
    """Stop the action; answered by ActionStopped, or ActionFinished if it was quicker."""

    ticket: int


@dataclass(frozen=True, slots=True)
class RequestBid:
    """Have the robot's program bid for a local task; it is answered by BidsMade.

    `performance`: the declared one.
    """

    activation: str
    global_task: str
    local_task: str
    performance: int
    incarnation: Incarnation


@dataclass(frozen=True, slots=True)
class DeclareToken:
    """Show the liveliness token of this incarnation, in place of an earlier one."""

    incarnation: Incarnation


@dataclass(frozen=True, slots=True)
class Log:
    """One line for the robot's log."""

    level: str
    event: str
    fields: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Stop:
    """The agent is done: 0 mission succeeded or left on purpose, 1 failed, 2 refused."""

    code: int
    reason: str


Effect: TypeAlias = (
    Publish
    | Persist
    | Forget
    | Ask
    | AskRouter
    | Reply
    | StartAction
    | MakePlan
    | SearchSchedule
    | CheckMission
    | UseMission
    | CancelAction
    | RequestBid
    | DeclareToken
    | Log
    | Stop
)
