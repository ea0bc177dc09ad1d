"""Follows a recording that is played: who waits for whom, who differs, who has left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.observer.episodes import MajorFault
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.planning.plan import Waiting
from mrbt_mesh.views.model.agreement import AgreementView, reported_plans
from mrbt_mesh.views.model.why import candidates, why_takeover
from mrbt_mesh.views.report.model import Disagreement, Wait, WaitKind
from mrbt_mesh.views.report.plans_held import PlansHeld

MOST_CANDIDATES = 6


@dataclass
class Episodes:
    """Times during which something held, by what it is: (from, to, robots), in µs."""

    ended: list[tuple[tuple[str, str], int, int, tuple[str, ...]]] = field(default_factory=list)
    _open: dict[tuple[str, str], tuple[int, tuple[str, ...]]] = field(default_factory=dict)

    def has(self, key: tuple[str, str]) -> bool:
        """Whether it holds already."""
        return key in self._open

    def look(self, found: Mapping[tuple[str, str], tuple[str, ...]], now_us: int) -> None:
        """These hold now, and no others; those robots count that were there when it began."""
        for key in [key for key in self._open if key not in found]:
            from_us, robots = self._open.pop(key)
            if now_us > from_us:
                self.ended.append((key, from_us, now_us, robots))
        for key, robots in found.items():
            self._open.setdefault(key, (now_us, robots))


class Following:
    """Call `look` after each step of the player, and `end` once."""

    def __init__(self) -> None:
        self.takeovers: dict[int, str] = {}
        self.plans_held = PlansHeld()
        self._agreement = AgreementView()
        self._tasks, self._idle = Episodes(), Episodes()
        self._differing, self._left = Episodes(), Episodes()

    def look(self, observer: Observer, now_us: int) -> None:
        """See how things are now."""
        plan = observer.plan
        if observer.record.started_us is None:
            return
        waiting = {(w.global_task, w.reason): w for w in plan.waiting} if plan else {}
        # Whom a task waits for is looked up once, when it begins to wait.
        self._tasks.look(
            {
                key: () if self._tasks.has(key) else _awaited(observer, each)
                for key, each in waiting.items()
            },
            now_us,
        )
        alive = {r for r in observer.robots() if observer.robot_state(r).is_member}
        idle = plan.idle if plan else {}
        self._idle.look({(r, why): () for r, why in idle.items() if r in alive}, now_us)
        self.plans_held.look(reported_plans(observer), now_us)
        differ = tuple(sorted(self._agreement.look(observer, now_us)["differ"]))
        self._differing.look({(", ".join(differ), ""): differ} if differ else {}, now_us)
        states = {robot: observer.robot_state(robot) for robot in observer.robots()}
        self._left.look({(r, ""): () for r, s in states.items() if s is State.LEFT}, now_us)
        for index, fault in enumerate(observer.record.major):
            if fault.replacement and fault.held and index not in self.takeovers:
                self.takeovers[index] = _could(observer, fault)

    def end(self, now_us: int) -> None:
        """The run is over: what holds, held until now."""
        for episodes in (self._tasks, self._idle, self._differing, self._left):
            episodes.look({}, now_us)
        self.plans_held.end(now_us)

    def left_us(self, robot: str) -> list[tuple[int, int]]:
        """When the robot had left the team."""
        return [(a, b) for (name, _), a, b, _ in self._left.ended if name == robot]

    def waits(self, start_us: int) -> list[Wait]:
        """Of tasks and of robots without one."""
        return [
            Wait(kind, who, (a - start_us) / 1e6, (b - start_us) / 1e6, reason, robots)
            for kind, episodes in ((WaitKind.TASK, self._tasks), (WaitKind.IDLE, self._idle))
            for (who, reason), a, b, robots in episodes.ended
        ]

    def differences(self, start_us: int) -> tuple[Disagreement, ...]:
        """When robots reported different plans."""
        return tuple(
            Disagreement((a - start_us) / 1e6, (b - start_us) / 1e6, robots)
            for _, a, b, robots in self._differing.ended
        )


def _awaited(observer: Observer, waiting: Waiting) -> tuple[str, ...]:
    """The robots that could serve the request and do something else, or whose bids are missing."""
    if waiting.awaited or waiting.is_blocked or observer.plan is None:
        return tuple(waiting.awaited)
    lines = observer.plan.lines
    return tuple(
        sorted(
            {
                each.robot
                for need in observer.mission.global_tasks[waiting.global_task].needs
                for each in candidates(observer, waiting.activation, need.local_task)
                if each.robot in lines and not each.is_chosen and each.performance is not None
            }
        )
    )


def _could(observer: Observer, fault: MajorFault) -> str:
    """Who could take over what it held, and how things stood with each of them."""
    groups = why_takeover(observer, fault)["groups"]
    found = [each for group in groups for each in group["candidates"]]
    texts = []
    for each in found[:MOST_CANDIDATES]:
        bid = each["performance"]
        number = "no bid" if bid is None else f"performance {bid:g}"
        texts.append(f"{each['robot']} ({number}) {each['reason']}")
    more = len(found) - len(texts)
    return "; ".join(texts) + (f"; and {more} more" if more > 0 else "")
