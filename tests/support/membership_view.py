"""One robot's view of who is alive, told what it hears."""

from __future__ import annotations

from collections.abc import Iterable

from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.dissemination import Dissemination, Urgent
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Heartbeat, SelfReport, Suspicion

MS = 1_000
TIMING = Timing(heartbeat_us=100 * MS, detection_us=1_000 * MS)
ALIVE, SUSPECT, DEAD, LEFT = State.ALIVE, State.SUSPECT, State.DEAD, State.LEFT
PLAN = b"planplan"


# Nothing that others must hear at once.
CALM = Urgent(b"", 0, (), True, False, None, (), 0, False)


def recipients(around: Dissemination, number: int, is_new: bool = False) -> tuple[str, ...] | None:
    """The robots that get heartbeat `number`, after the first, if nothing is urgent."""
    around.route(CALM, number, False, is_new, None) if number == 1 else None
    return around.route(CALM, number, False, is_new, None).to


class View:
    """Robot M's view of the others, told what it hears at which millisecond; with `me` empty that
    of an observer.
    """

    def __init__(self, *robots: str, me: str = "M") -> None:
        self.members = Membership(me, TIMING, (me, *robots) if me else ())
        self.ms = 0
        self.numbers: dict[str, int] = {}
        self.can_answer = False
        for robot in robots:
            self.hear(robot)

    def at(self, ms: int) -> View:
        """Let time pass, and judge."""
        self.ms = ms
        self.members.detect_failures(ms * MS)
        return self

    def hear(
        self,
        robot: str,
        *,
        lost_token: Iterable[str] = (),
        probes: Iterable[str] = (),
        declares_dead: Iterable[str] = (),
        relays: dict[str, int] | None = None,
        life: int = 1,
        number: int | None = None,
        joined: bool = True,
        leaving: bool = False,
        plan: bytes = PLAN,
        result: Status = Status.RUNNING,
    ) -> bool:
        """A heartbeat of `robot`: it lost tokens of robots, probes silent ones,
        declares others dead, and relays newer self-reports.
        """
        self.numbers[robot] = self.numbers.get(robot, 0) + 1 if number is None else number
        one = Incarnation(1, "n")
        suspicions = (
            *(Suspicion(each, one, True, False, False) for each in lost_token),
            *(Suspicion(each, one, False, False, True) for each in probes),
            *(Suspicion(each, one, False, True, False) for each in declares_dead),
        )
        heard = {
            each: SelfReport(Incarnation(1, "n"), n, plan, True, int(result))
            for each, n in (relays or {}).items()
        }
        beat = Heartbeat(
            SelfReport(Incarnation(life, "n"), self.numbers[robot], plan, joined, int(result)),
            leaving,
            b"f" * 8,
            (0, 0, 0, 0),
            0,
            suspicions,
            heard,
        )
        news = self.members.receive_heartbeat(robot, beat, self.ms * MS)
        self.can_answer = self.members.can_answer_probe(beat, Incarnation(5, "m"))
        self.members.detect_failures(self.ms * MS)
        return news

    def lose_token(self, robot: str, life: int = 1) -> None:
        self.members.receive_token(robot, Incarnation(life, "n"), False)
        self.members.detect_failures(self.ms * MS)

    def __getitem__(self, robot: str) -> State:
        return self.members.peers[robot].state

    def states(self, robots: str) -> list[State]:
        return [self[robot] for robot in robots]
