"""A step of a drill as a sentence."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.drills.model import (
    BlockedTrigger,
    CapabilityModel,
    ConditionTrigger,
    DecisionModel,
    DelayModel,
    GlobalTaskTrigger,
    LinksModel,
    LocalTaskTrigger,
    LossModel,
    PerformanceModel,
    Robots,
    RobotTrigger,
    RoleModel,
    StepModel,
    TakeoverTrigger,
)

_VERBS = {
    "kill": "kill",
    "stop": "freeze",
    "continue": "thaw",
    "leave": "send away",
    "restart": "start again",
    "join": "start",
}


def step_text(step: StepModel) -> str:
    """`when replace_hw(2) runs, after 0.2 s: freeze whoever performs replace_hw(2)`."""
    moments = []
    if step.at is not None:
        moments.append(f"{step.at:g} s after the start")
    if step.when is not None:
        moments.append(f"when {_trigger(step.when)}")
    if step.after is not None:
        moments.append(f"after {step.after:g} s")
    faults = " and ".join(_fault(name, fault) for name, fault in step.faults())
    return f"{', '.join(moments)}: {faults}"


def _trigger(when: Any) -> str:
    match when:
        case GlobalTaskTrigger(global_task=task, status=status):
            return f"{task} is {status}"
        case LocalTaskTrigger(local_task=task, robot=robot, phase=phase):
            return f"{robot or 'somebody'} has {task} {phase}"
        case RobotTrigger(robot=robots, state=state):
            return f"{_robots(robots)} is {state}"
        case ConditionTrigger(condition=name, value=value):
            return f"{name} is {str(value).lower()}"
        case TakeoverTrigger(takeover=task):
            return f"somebody has taken {task} over"
        case BlockedTrigger(blocked=task):
            return f"{task} is blocked"
    raise TypeError(f"no trigger: {when!r}")


def _fault(name: str, fault: Any) -> str:
    match fault:
        case True:
            return {"kill_team": "kill all robots", "resume_team": "start all again"}.get(
                name, "mend the network"
            )
        case int():
            return f"{name.replace('_', ' ')} {fault}"
        case CapabilityModel(robots=robots, local_task=task):
            verb = "lose" if name == "lose_capability" else "get back"
            return f"have {_robots(robots)} {verb} {task}"
        case PerformanceModel(robots=robots, local_task=task, performance=value):
            return f"have {_robots(robots)} do {task} at {value:g}"
        case DecisionModel(global_task=task, decision=decision):
            return f"say that {task} counts as {decision}"
        case LinksModel(source=source, target=target):
            ends = f"from {_robots(source)} to {_robots(target)}"
            match fault:
                case LossModel(permille=permille):
                    return f"lose {permille / 10:g} % of the messages {ends}"
                case DelayModel(ms=delay_ms):
                    return f"delay messages {ends} by {delay_ms} ms"
            return f"{name} links {ends}"
        case list() if name == "partition":
            return "cut the team into " + " | ".join(_robots(group) for group in fault)
    return f"{_VERBS[name]} {_robots(fault)}"


def _robots(robots: Robots | None) -> str:
    if robots is None:
        return "everybody"
    if isinstance(robots, str):
        return robots
    if isinstance(robots, RoleModel):
        if robots.performing is not None:
            return f"whoever performs {robots.performing}"
        return {
            "replacement": "the replacement",
            "killed": "those that were killed",
            "stopped": "those that are frozen",
            "thawed": "those that were thawed",
            "left": "those that have left",
        }[robots.role]
    return ", ".join(robots)
