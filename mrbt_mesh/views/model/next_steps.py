"""What happens next to a global task, a robot or a job, as far as an observer can tell."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.jobs import KnownJob
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.planning.plan import Waiting
from mrbt_mesh.observer.forecast import ExpectedStep, forecast_of
from mrbt_mesh.observer.headline import remedies
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.time_at_work import time_at_work

# How many steps of a robot's schedule are shown.
MOST_STEPS = 3


@dataclass(frozen=True, slots=True)
class NextStep:
    """What happens next. `text` is a phrase: `fails`.

    `at_s`: when, in seconds from the start of the run; None: unknown.
    """

    text: str
    at_s: float | None = None


def next_of_task(observer: Observer, task: str, now_us: int) -> list[NextStep]:
    """Return the next steps of a requested global task. Raises KeyError if it is unknown."""
    _ = observer.facts.mission.global_tasks[task]
    plan = observer.plan
    requests = plan.evaluation.requests if plan is not None and not observer.is_over else ()
    activations = [request.activation for request in requests if request.subject == task]
    return _of_activations(observer, activations, now_us)


def next_of_robot(observer: Observer, robot: str, now_us: int) -> list[NextStep]:
    """Return the next steps of a robot. Raises KeyError if it is unknown."""
    if robot not in observer.robots():
        raise KeyError(robot)
    if observer.is_over:
        return []
    if observer.robot_state(robot) is State.DEAD:
        back = NextStep(f"is counted on again once it is heard (`mrbt join {robot}`)")
        return [*_of_held(observer, robot), back]
    claim, found = observer.claim(robot), []
    if claim is not None and claim.phase is Phase.RUNNING:
        at_work = time_at_work(observer, robot, now_us)
        if at_work is not None and at_work.expected_s is not None:
            ends_us = at_work.since_us + round(at_work.expected_s * 1e6)
            ends_s = observer.record.seconds(ends_us)
            found.append(NextStep(f"should end {claim.local_task}", ends_s))
    ahead = forecast_of(observer, now_us)
    steps = ahead.robots[robot].steps if ahead is not None and robot in ahead.robots else ()
    now_s = observer.record.seconds(now_us)
    return found + [_expected(step, now_s) for step in steps[:MOST_STEPS]]


def _of_held(observer: Observer, robot: str) -> list[NextStep]:
    """Return who takes over what a dead robot had, if nobody has done so yet."""
    fault = next((f for f in reversed(observer.record.major) if f.robot == robot), None)
    held, plan = fault.held if fault is not None else None, observer.plan
    if fault is None or held is None or plan is None or fault.replacement is not None:
        return []
    wanted = held.activation, held.local_task
    lines = [x for x in plan.assignments.values() if (x.activation, x.local_task) == wanted]
    return [NextStep(f"{line.robot} takes over its {held.local_task}") for line in lines]


def next_of_job(observer: Observer, job: str, now_us: int) -> list[NextStep]:
    """Return the next steps of a job. Raises KeyError if it is unknown."""
    jobs = observer.facts.jobs
    known = jobs.known[job] if jobs is not None else None
    if known is None:
        raise KeyError(job)
    plan, found = observer.plan, []
    if known.job is None or known.end is not None or observer.is_over:
        return []
    if not known.is_due:
        found.append(NextStep("may begin", run_seconds(observer, known.job.not_before_us)))
    requests = plan.evaluation.requests if plan is not None else ()
    own = [r.activation for r in requests if parse_activation(r.activation).job == job]
    found += _of_activations(observer, own, now_us)
    return found + _deadline(observer, known)


def steps_to_json(steps: Iterable[NextStep]) -> list[dict[str, Any]]:
    """Return plain data."""
    return [asdict(step) for step in steps]


def run_seconds(observer: Observer, unix_us: int | None) -> float | None:
    """Return a Unix time in seconds from the start of the run.

    None if there is none or it is unknown.
    """
    ahead_us = observer.clock_ahead_us()
    if not unix_us or ahead_us is None:
        return None
    return observer.record.seconds(unix_us - ahead_us)


def _of_activations(observer: Observer, activations: list[str], now_us: int) -> list[NextStep]:
    plan = observer.plan
    assert plan is not None or not activations
    waiting = {w.activation: w for w in plan.waiting} if plan is not None else {}
    found: list[NextStep] = []
    for activation in activations:
        if activation in waiting:
            found += _of_waiting(observer, waiting[activation])
    ahead = forecast_of(observer, now_us) if activations else None
    now_s = observer.record.seconds(now_us)
    for robot, each in ahead.robots.items() if ahead is not None else ():
        for step in each.steps:
            if step.activation in activations:
                expected = _expected(step, now_s)
                found.append(NextStep(f"{robot} {expected.text}", expected.at_s))
    return found


def _of_waiting(observer: Observer, waiting: Waiting) -> list[NextStep]:
    """Return what becomes of a request that is not served."""
    if not waiting.is_blocked:
        awaits_robots = not (waiting.held_by or waiting.awaited)
        return [NextStep("begins once robots are free")] if awaits_robots else []
    found: list[NextStep] = []
    task = observer.facts.mission.global_tasks[waiting.global_task]
    limit_us, since_us = task.blocked_fail_after_us, _blocked_since_us(observer, waiting)
    if waiting.shortages and limit_us is not None and since_us is not None:
        found.append(NextStep("fails", observer.record.seconds(since_us + limit_us)))
    helps = [text for shortage in waiting.shortages for text in remedies(observer, shortage)]
    return found + [NextStep(text) for text in helps]


def _blocked_since_us(observer: Observer, waiting: Waiting) -> int | None:
    """Return since when a request has been blocked continuously, whatever the reasons were."""
    since_us: int | None = None
    for episode in reversed(observer.record.blocked):
        if episode.request == waiting.global_task and episode.to_us in (None, since_us):
            since_us = episode.from_us
    return since_us


def _expected(step: ExpectedStep, now_s: float | None) -> NextStep:
    """Return an expected step; its `begins_s` counts from now."""
    where = f" at {step.place}" if step.place else ""
    partners = f" with {', '.join(step.partners)}" if step.partners else ""
    at_s = None if now_s is None else round(now_s + step.begins_s, 3)
    return NextStep(f"begins {step.local_task}{where}{partners}", at_s)


def _deadline(observer: Observer, known: KnownJob) -> list[NextStep]:
    at_s = run_seconds(observer, known.job.deadline_us if known.job is not None else None)
    return [] if at_s is None else [NextStep("expires unless it has ended", at_s)]
