"""The effects of an agent: plain data without behaviour."""

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
    """Send to these robots and to observers. `to` None: to everybody."""

    kind: MessageKind
    data: bytes
    to: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class Persist:
    """Keep these entries in the journal: `at_once`, or a little later together with others.

    Unless `number` is 0, JournalSynced answers once these and all earlier entries are on disk.
    """

    entries: tuple[Entry, ...]
    at_once: bool
    number: int = 0


@dataclass(frozen=True, slots=True)
class Forget:
    """These entries, by author and name, are out of reach: the journal may drop them."""

    keys: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Ask:
    """Send a PULL to one peer. Its answer comes back as AnswerReceived."""

    peer: str
    data: bytes


@dataclass(frozen=True, slots=True)
class AskRouter:
    """Ask a router whether it or another router has a link to this robot.

    Answered by RouterAnswered.
    """

    robot: str
    incarnation: Incarnation
    router: str


@dataclass(frozen=True, slots=True)
class Reply:
    """Answer a query with one message or, for a PULL of many facts, several pages."""

    query: int
    pages: tuple[bytes, ...]


@dataclass(frozen=True, slots=True)
class StartAction:
    """Run a local task. Ends with ActionFinished or, after CancelAction, ActionStopped.

    `party`: the name of those with whom it runs the task jointly, empty if it does not.
    `travel_to`: the action is only the way to this place, where the local task happens; empty: it
    is the local task itself. `values`: the values of the blackboard entries that serve as
    arguments, by entry.
    """

    ticket: int
    activation: str
    global_task: str
    local_task: str
    partners: tuple[str, ...]
    performance: int
    incarnation: Incarnation
    party: str = ""
    travel_to: str = ""
    values: tuple[tuple[str, str], ...] = ()

    @property
    def called(self) -> dict[str, str]:
        """The tasks with these values as arguments, as shown to programs and people."""
        names = {"global_task": self.global_task, "local_task": self.local_task}
        values = dict(self.values)
        return {key: with_entries(n, values) for key, n in names.items()} if values else names


@dataclass(frozen=True, slots=True)
class MakePlan:
    """Call `make`, in another thread if possible. Answered by PlanMade with the same number."""

    number: int
    make: Callable[[], Plan] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class SearchSchedule:
    """Carry out these steps in the background. ScheduleFound with this number answers the last."""

    number: int
    steps: Iterator[Dispatched] = field(repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class UseMission:
    """This mission is in force: whatever begins from now on belongs to it."""

    mission: Mission = field(repr=False)


@dataclass(frozen=True, slots=True)
class CancelAction:
    """Stop the action. Answered by ActionStopped, or by ActionFinished if it ended first."""

    ticket: int


@dataclass(frozen=True, slots=True)
class FeatureEffect:
    """Base of what features ask of the robot's program. Answered by an input of the feature."""


@dataclass(frozen=True, slots=True)
class DeclareToken:
    """Declare the liveliness token of this incarnation, replacing an earlier one."""

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
    | UseMission
    | CancelAction
    | FeatureEffect
    | DeclareToken
    | Log
    | Stop
)
