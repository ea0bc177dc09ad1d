"""Explains why a robot does its task, a task waits, or a robot took over.

An explanation is a sentence with numbers, and the other candidates.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Request
from mrbt_mesh.core.facts.records import Claim, Member
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import MICRO, Need, performance
from mrbt_mesh.core.mission.names import name_order, type_name
from mrbt_mesh.core.planning.plan import Plan, assignment_reason, shortened
from mrbt_mesh.features.bids.plan import plan_bids
from mrbt_mesh.observer.episodes import MajorFault, after_text
from mrbt_mesh.observer.headline import wanted_activations
from mrbt_mesh.observer.job_rows import RUNNING, WAITING, JobRows
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.task_log import TaskRecord, TaskState


@dataclass(frozen=True, slots=True)
class Candidate:
    """A robot that can do a local task, or could.

    `performance` is in units; None: it made no bid. `chosen`: the plan assigns it. `reason`: why,
    or why not.
    """

    robot: str
    performance: float | None
    chosen: bool
    reason: str


def candidates(observer: Observer, activation: str, local_task: str) -> list[Candidate]:
    """Return all robots with the capability, the chosen ones first, then by performance."""
    found = []
    for robot, known in observer.facts.members.items():
        declared = performance(known.member.capabilities, local_task)
        if declared is not None:
            found.append(_candidate(observer, robot, declared, activation, local_task))

    def order(each: Candidate) -> tuple[Any, ...]:
        # Robots without a bid come last.
        number = float("-inf") if each.performance is None else each.performance
        return not each.chosen, -number, name_order(each.robot)

    return sorted(found, key=order)


def _candidate(
    observer: Observer, robot: str, declared: int, activation: str, local_task: str
) -> Candidate:
    plan, member = observer.plan, observer.facts.members[robot].member
    bids = plan_bids(plan).get((activation, local_task)) if plan is not None else None
    number: int | None = declared if bids is None else bids.get(robot)
    units = None if number is None else number / MICRO
    state = observer.robot_state(robot)
    if state is State.DEAD:
        return Candidate(robot, units, False, "is dead")
    if state is State.LEFT:
        return Candidate(robot, units, False, "has left")
    if capability(member, local_task) is None:
        return Candidate(robot, units, False, _lost(member, local_task))
    line = plan.assignments.get(robot) if plan is not None else None
    if line is not None and (line.activation, line.local_task) == (activation, local_task):
        how = "goes on with it" if line.pinned else "is chosen: the best assignment of all robots"
        if not line.pinned and plan is not None and plan.ahead is not None:
            is_next = plan.ahead.is_next(robot, activation)
            how = "is chosen: its first task of the schedule" if is_next else how
        return Candidate(robot, units, True, how)
    if observer.facts.results(activation, local_task).get(robot) is False:
        return Candidate(robot, units, False, _failed(observer, robot, activation, local_task))
    if line is not None:
        verb = "goes on with" if line.pinned else "does"
        other = f"{verb} {line.local_task} for {line.global_task}"
        return Candidate(robot, units, False, f"{other} ({line.performance / MICRO:g})")
    bid_problem = observer.facts.problems.get(robot, {}).get(f"bid for {type_name(local_task)}")
    if bids is not None and number is None and bid_problem is not None:
        return Candidate(robot, None, False, bid_problem)
    if robot in observer.idle:
        return Candidate(robot, units, False, f"is free: {observer.idle[robot]}")
    claim = observer.claim(robot)
    if claim is not None:
        # A plan computed from a recording may not count on it yet.
        return Candidate(robot, units, False, f"does {claim.local_task} for {claim.global_task}")
    return Candidate(robot, units, False, "is joining")


def _lost(member: Member, local_task: str) -> str:
    """Return why a member cannot use a capability now."""
    for found, text in (
        (member.lost, "has lost this capability"),
        (member.pending, "cannot use this capability yet"),
    ):
        for name in (local_task, type_name(local_task)):
            if name in found:
                return f"{text}: {found[name]}" if found[name] else text
    return "has lost this capability"


def _failures(observer: Observer, task: str) -> str:
    """Return why robots failed at a global task: the last reason of each."""
    said = {e.robot: e for e in observer.record.failures if e.global_task == task and e.reason}
    robots = sorted(said, key=name_order)
    return "".join(f" {r} failed at {said[r].local_task}: {said[r].reason}." for r in robots)


def _failed(observer: Observer, robot: str, activation: str, local_task: str) -> str:
    place = (robot, parse_activation(activation).subject, local_task)
    reasons = [
        end.reason
        for end in observer.record.failures
        if (end.robot, end.global_task, end.local_task) == place
    ]
    return f"has failed at it: {reasons[-1]}" if reasons and reasons[-1] else "has failed at it"


def _number(each: Candidate) -> str:
    return each.robot if each.performance is None else f"{each.robot} ({each.performance:g})"


def _others(found: list[Candidate], but: str) -> str:
    """Return a sentence about the other candidates."""
    others = [each for each in found if each.robot != but]
    if not others:
        return "No other robot has this capability."
    listed = "; ".join(f"{_number(each)} {each.reason}" for each in others[:4])
    more = f"; and {len(others) - 4} more" if len(others) > 4 else ""
    return f"Others with this capability: {listed}{more}."


def _answer(
    subject: str, sentence: str, found: list[Candidate], local_task: str = ""
) -> dict[str, Any]:
    return {
        "subject": subject,
        "sentence": sentence,
        "groups": [{"local_task": local_task, "candidates": [asdict(each) for each in found]}]
        if found
        else [],
    }


def why_robot(observer: Observer, robot: str) -> dict[str, Any]:
    """Explain what a robot does. Raises KeyError if it is unknown."""
    if robot not in observer.robots():
        raise KeyError(robot)
    plan, state = observer.plan, observer.robot_state(robot)
    if state is State.DEAD:
        faults = [fault for fault in observer.record.major if fault.robot == robot]
        if faults:
            return _answer(robot, fault_sentence(observer, faults[-1]), [])
        return _answer(robot, f"{robot} is dead: no message from it since.", [])
    if state is State.LEFT:
        return _answer(robot, f"{robot} has left on purpose, and handed its work over.", [])
    if plan is None or robot not in {*plan.assignments, *plan.idle}:
        return _answer(robot, f"{robot} is joining the team: plans do not count on it yet.", [])
    line = plan.assignments.get(robot)
    if line is None:
        return _answer(robot, f"{robot} does nothing now: {observer.idle[robot]}.", [])
    found = candidates(observer, line.activation, line.local_task)
    reason = assignment_reason(plan, robot)
    what = f"{robot} does {line.local_task} for {line.global_task}: {reason}."
    return _answer(robot, f"{what} {_others(found, robot)}", found, line.local_task)


def why_task(observer: Observer, task: str) -> dict[str, Any]:
    """Explain the state of a global task. Raises KeyError if it is unknown."""
    _ = observer.facts.mission.global_tasks[task]
    record = observer.record.task_log.tasks.get(task, TaskRecord())  # of a job, none
    plan = observer.plan
    requests = [r for r in plan.evaluation.requests if r.subject == task] if plan else []
    if plan is None or not requests:
        why = _failures(observer, task) if record.state is TaskState.FAILURE else ""
        return _answer(task, f"{task} {_ENDS[record.state]}.{_by(record.robots)}{why}", [])
    return _why_request(observer, plan, requests[0])


def _why_request(observer: Observer, plan: Plan, request: Request) -> dict[str, Any]:
    """Explain who serves a request, or why nobody does."""
    task, activation = request.subject, request.activation
    known = observer.facts.mission.global_tasks[task]
    waiting = next((w for w in plan.waiting if w.activation == activation), None)
    lines = [line for line in plan.assignments.values() if line.activation == activation]
    bounds = "; ".join(map(_needed, known.needs))
    if waiting is not None:
        sentence = f"{task} is {waiting.reason}. It needs {bounds}."
    elif not lines and plan.ahead is not None and (step := plan.ahead.step_of(activation)):
        later = shortened(plan.ahead.members(step))
        sentence = f"{task} is done later by {later}: {plan.ahead.author}'s schedule."
    elif not lines:
        sentence = f"{task} is requested, and no robot is assigned to it. It needs {bounds}."
    else:
        working = shortened([line.robot for line in lines])
        sentence = f"{task} is carried out by {working}. It needs {bounds}."
    groups = [
        {
            "local_task": need.local_task,
            "candidates": [
                asdict(each) for each in candidates(observer, activation, need.local_task)
            ],
        }
        for need in known.needs
    ]
    return {"subject": task, "sentence": sentence, "groups": groups}


def why_job(observer: Observer, job: str) -> dict[str, Any]:
    """Explain the state of a job by its first waiting task, else by its first running one.

    Raises KeyError if it is unknown.
    """
    row = next((row for row in JobRows().of(observer) if row.id == job), None)
    if row is None:
        raise KeyError(job)
    subject, why = f"job {job}", f": {row.why}" if row.why else ""
    plan = observer.plan
    requests = plan.evaluation.requests if plan is not None else ()
    own = [r for r in requests if parse_activation(r.activation).job == job]
    if plan is None or not own or row.state not in (WAITING, RUNNING):
        return _answer(subject, f"{job} is {row.state}{why}.{_by(set(row.robots))}", [])
    waiting = {w.activation for w in plan.waiting}
    first = min(own, key=lambda request: request.activation not in waiting)
    # The reason of the job is the reason of its task.
    told = _why_request(observer, plan, first)
    return told | {"subject": subject, "sentence": f"{job} is {row.state}: {told['sentence']}"}


_ENDS = {
    TaskState.IDLE: "is not requested: the tree does not reach it now",
    TaskState.RUNNING: "is requested, and not planned yet",
    TaskState.SUCCESS: "has succeeded",
    TaskState.FAILURE: "has failed",
    TaskState.CANCELLED: "is no longer requested, and has no result",
}


def _by(robots: set[str]) -> str:
    return f" {', '.join(sorted(robots, key=name_order))} took part." if robots else ""


def _needed(need: Need) -> str:
    least, most = need.min_robots, need.max_robots
    count = f"{least}" if least == most else f"{least} to {most}"
    return f"{count} for {need.local_task}{need.after}"


def why_takeover(observer: Observer, fault: MajorFault) -> dict[str, Any]:
    """Explain why the replacement took over, by the current state: call it right after the
    takeover.
    """
    told, held = takeover_told(observer, fault), fault.held
    if held is None:
        return told
    found = candidates(observer, held.activation, held.local_task)
    sentence = told["sentence"]
    if fault.replacement is not None:
        own = next((each for each in found if each.robot == fault.replacement), None)
        # The plan may still be the one from before the death.
        known = {fault.replacement: "has taken over", fault.robot: "is dead"}
        found = [replace(e, chosen=e is own, reason=known.get(e.robot, e.reason)) for e in found]
        found.sort(key=lambda each: not each.chosen)
        if own is not None and own.performance is not None:
            sentence += f" {fault.replacement} does it with {own.performance:g}."
        sentence += f" {_others(found, fault.replacement)}"
    return _answer(told["subject"], sentence, found, held.local_task)


def takeover_told(observer: Observer, fault: MajorFault) -> dict[str, Any]:
    """Describe a takeover without its reasons, which are no longer known."""
    held: Claim | None = fault.held
    subject = f"takeover of {held.local_task}" if held else f"death of {fault.robot}"
    return _answer(subject, fault_sentence(observer, fault), [])


def fault_sentence(observer: Observer, fault: MajorFault) -> str:
    """Describe a death with its times, and who took over."""
    at_s = observer.record.seconds(fault.at_us) or 0.0
    text = f"{fault.robot} died at {at_s:.1f} s"
    if fault.is_older:
        text = f"{fault.robot} died before the run was watched"
    elif fault.detected_after_us is not None:
        text += f"; the others knew after {after_text(fault.detected_after_us, fault.exact)}"
    if fault.held is None:
        return f"{text}. It held no task."
    if fault.is_older:
        return f"{text}. {fault.replacement or 'Nobody'} has its {fault.held.local_task} since."
    if fault.reassigned_after_us is None:
        if fault.held.activation not in wanted_activations(observer):
            return f"{text}. Its {fault.held.local_task} is no longer needed."
        return f"{text}. Nobody has taken over its {fault.held.local_task} yet."
    took = f"{fault.replacement} took over its {fault.held.local_task}"
    seen = "" if fault.exact else ", as seen by the observer"
    return f"{text}. {took} after {after_text(fault.reassigned_after_us, fault.exact)}{seen}."
