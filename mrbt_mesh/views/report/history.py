"""Collects from a played recording: waiting robots, differing plans, the plans that robots hold."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.core.facts.records import Proposal
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.planning.plan import Waiting
from mrbt_mesh.observer.episodes import MajorFault
from mrbt_mesh.observer.forecast import ExpectedStep, forecast_of
from mrbt_mesh.observer.headline import reported_plans
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.views.model.team_view import AgreementView
from mrbt_mesh.views.model.why import candidates, why_takeover
from mrbt_mesh.views.report.model import Disagreement, ReportedPlan, Wait, WaitKind

MOST_CANDIDATES = 6
DIGEST_BYTES = 4


@dataclass
class Episodes:
    """Periods during which something held, by what it is: (from, to, robots), in µs."""

    ended: list[tuple[tuple[str, str], int, int, tuple[str, ...]]] = field(default_factory=list)
    open: dict[tuple[str, str], tuple[int, tuple[str, ...]]] = field(default_factory=dict)

    def look(self, found: Mapping[tuple[str, str], tuple[str, ...]], now_us: int) -> None:
        """Update what holds now; an episode keeps the robots from its begin."""
        for key in [key for key in self.open if key not in found]:
            from_us, robots = self.open.pop(key)
            if now_us > from_us:
                self.ended.append((key, from_us, now_us, robots))
        for key, robots in found.items():
            self.open.setdefault(key, (now_us, robots))


@dataclass
class _HeldPlan:
    """A plan while robots report it. `since_us`: robot -> when it first reported it."""

    digest: bytes
    from_us: int
    since_us: dict[str, int] = field(default_factory=dict)
    all_us: int | None = None
    to_us: int = 0


class PlansHeld:
    """Which plans robots reported, and when each of them and all of them did."""

    def __init__(self) -> None:
        self._all: list[_HeldPlan] = []
        # By digest, while any robot reports it: a team may return to an earlier plan.
        self._open: dict[bytes, _HeldPlan] = {}

    def look(self, digests: Mapping[str, bytes], now_us: int) -> None:
        """Update the plans reported by robots in good standing.

        No digest: the robot has no plan.
        """
        reported = set(digests.values())
        for digest in [each for each in self._open if each not in reported]:
            self._open.pop(digest).to_us = now_us
        for robot, digest in sorted(digests.items()):
            if not digest:
                continue
            if digest not in self._open:
                self._open[digest] = _HeldPlan(digest, now_us)
                self._all.append(self._open[digest])
            self._open[digest].since_us.setdefault(robot, now_us)
        if len(reported) == 1 and (held := self._open.get(min(reported))) is not None:
            held.all_us = now_us if held.all_us is None else held.all_us

    def plans(self, start_us: int) -> tuple[ReportedPlan, ...]:
        """Return the plans in the order of their begin; all have ended."""
        return tuple(
            ReportedPlan(
                number,
                held.digest[:DIGEST_BYTES].hex(),
                (held.from_us - start_us) / 1e6,
                None if held.all_us is None else (held.all_us - start_us) / 1e6,
                (held.to_us - start_us) / 1e6,
                {robot: (at_us - start_us) / 1e6 for robot, at_us in held.since_us.items()},
            )
            for number, held in enumerate(self._all, start=1)
        )


class History:
    """Call `look` after each step of the player, and `end` once.

    `scheduled`: activation -> what the last schedule with it predicted when it took effect.
    """

    def __init__(self) -> None:
        self.scheduled: dict[str, tuple[int, str, dict[str, ExpectedStep]]] = {}
        # The proposal in force, None for rules; activation -> the robots of its prediction.
        self._in_force: Proposal | None = None
        self._crews: dict[str, list[str]] = {}
        self.takeovers: dict[int, str] = {}
        self.plans_held = PlansHeld()
        self._agreement = AgreementView()
        self._tasks, self._idle = Episodes(), Episodes()
        self._differing, self._left = Episodes(), Episodes()

    def look(self, observer: Observer, now_us: int) -> None:
        """Update from the current state."""
        plan = observer.plan
        if observer.record.started_us is None:
            return
        waiting = {(w.global_task, w.reason): w for w in plan.waiting} if plan else {}
        # The robots that a task waits for are determined once, when it begins to wait.
        self._tasks.look(
            {
                key: () if key in self._tasks.open else _awaited(observer, each)
                for key, each in waiting.items()
            },
            now_us,
        )
        states = {robot: observer.robot_state(robot) for robot in observer.robots()}
        members = {robot for robot, state in states.items() if state.is_member}
        self._idle.look({(r, why): () for r, why in observer.idle.items() if r in members}, now_us)
        self.plans_held.look(reported_plans(observer), now_us)
        differ = tuple(sorted(self._agreement.look(observer, now_us)))
        self._differing.look({(", ".join(differ), ""): differ} if differ else {}, now_us)
        self._left.look({(r, ""): () for r, s in states.items() if s is State.LEFT}, now_us)
        self._look_ahead(observer, now_us)
        for index, fault in enumerate(observer.record.major):
            if fault.replacement and fault.held and index not in self.takeovers:
                self.takeovers[index] = _could(observer, fault)

    def _look_ahead(self, observer: Observer, now_us: int) -> None:
        """Note a schedule's predictions when it takes effect.

        Later, note its predictions for tasks that are new or have other robots.
        """
        ahead = observer.plan.ahead if observer.plan is not None else None
        if ahead is None or ahead.schedule is None:
            return
        proposal = observer.facts.proposals.get(ahead.author)
        opens = ahead.opens
        crews = {
            opens[step.task].request.activation: ahead.members(step) for step in ahead.schedule
        }
        is_new = proposal is not None and proposal is not self._in_force
        news = {name for name, crew in crews.items() if is_new or self._crews.get(name) != crew}
        self._in_force = proposal
        found = forecast_of(observer, now_us) if news else None
        if found is None:
            return
        self._crews |= {name: crews[name] for name in news}
        steps: dict[str, dict[str, ExpectedStep]] = {}
        for robot, known in found.robots.items():
            for step in known.steps:
                if step.activation in news:
                    steps.setdefault(step.activation, {})[robot] = step
        self.scheduled |= {name: (now_us, ahead.author, each) for name, each in steps.items()}

    def end(self, now_us: int) -> None:
        """End the run: what holds now, held until now."""
        for episodes in (self._tasks, self._idle, self._differing, self._left):
            episodes.look({}, now_us)
        self.plans_held.look({}, now_us)

    def left_us(self, robot: str) -> list[tuple[int, int]]:
        """Return the periods during which the robot had left the team."""
        return [(a, b) for (name, _), a, b, _ in self._left.ended if name == robot]

    def waits(self, start_us: int) -> list[Wait]:
        """Return the waits of tasks, and of robots without a task."""
        return [
            Wait(kind, who, (a - start_us) / 1e6, (b - start_us) / 1e6, reason, robots)
            for kind, episodes in ((WaitKind.TASK, self._tasks), (WaitKind.IDLE, self._idle))
            for (who, reason), a, b, robots in episodes.ended
        ]

    def differences(self, start_us: int) -> tuple[Disagreement, ...]:
        """Return the periods during which robots reported different plans."""
        return tuple(
            Disagreement((a - start_us) / 1e6, (b - start_us) / 1e6, robots)
            for _, a, b, robots in self._differing.ended
        )


def _awaited(observer: Observer, waiting: Waiting) -> tuple[str, ...]:
    """Return robots that could serve the request but are busy, or whose bids are missing."""
    if waiting.awaited or waiting.is_blocked or observer.plan is None:
        return tuple(waiting.awaited)
    lines = observer.plan.assignments
    could = {
        each.robot
        for need in observer.facts.task(waiting.activation).needs
        for each in candidates(observer, waiting.activation, need.local_task)
        if each.robot in lines and not each.chosen and each.performance is not None
    }
    return tuple(sorted(could))


def _could(observer: Observer, fault: MajorFault) -> str:
    """Return which robots could take over what it held, and the state of each."""
    groups = why_takeover(observer, fault)["groups"]
    found = [each for group in groups for each in group["candidates"]]
    texts = []
    for each in found[:MOST_CANDIDATES]:
        bid = each["performance"]
        number = "no bid" if bid is None else f"performance {bid:g}"
        texts.append(f"{each['robot']} ({number}) {each['reason']}")
    more = len(found) - len(texts)
    return "; ".join(texts) + (f"; and {more} more" if more > 0 else "")
