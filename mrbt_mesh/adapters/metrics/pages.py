"""The pages for Prometheus: one robot with its view of the team, and a team as observed."""

from __future__ import annotations

import errno
import os
import time
from collections import Counter
from collections.abc import Iterator

from mrbt_mesh.adapters.metrics.families import (
    Distribution,
    Family,
    FamilyKind,
    Labels,
    by_name,
    counter,
    family,
    gauge,
    histogram,
    refusals_by_class,
    robot_label,
    task_label,
)
from mrbt_mesh.adapters.metrics.meter import Meter
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.facts.records import JOURNAL, Outcome
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.task_log import TaskState
from mrbt_mesh.runtime.journal_writer import SLOW
from mrbt_mesh.version import __version__

STATUSES = tuple(status.name.lower() for status in Status)
STATES, TASK_STATES = tuple(map(str, State)), tuple(map(str, TaskState))
DISK_FULL = os.strerror(errno.ENOSPC)
_REQUESTS = "Requests of T_G: served, waiting for busy robots, or blocked for lack of robots."


def robot_page(view: AgentView, meter: Meter) -> list[Family]:
    """Return all families of one robot. Must be called in the event loop."""
    return [*_itself(view, meter), *_work(view, meter), *_team(view, meter), *_traffic(view, meter)]


def _itself(view: AgentView, meter: Meter) -> Iterator[Family]:
    me = (view.robot, view.mission.name, view.header.run, __version__)
    labels = ("robot", "mission", "run", "version")
    yield family(FamilyKind.INFO, "mrbt_robot", "Which robot this is.", {me: 1.0}, *labels)
    text = "Whether the robot has its place in the team."
    yield gauge("mrbt_joined", text, float(not view.is_joining))
    text = "Number of its incarnation: grows when it starts again and when it fences itself."
    yield gauge("mrbt_incarnation", text, float(view.incarnation.counter))
    text = "How often it fenced itself after a silence of its own."
    yield counter("mrbt_fencings", text, float(meter.fencings))
    yield gauge("mrbt_lost_capabilities", "Capabilities that it has lost.", float(len(view.lost)))
    text = "By how much the event loop was late."
    yield histogram("mrbt_event_loop_lag_seconds", text, meter.lag_s)
    text = "Time of a write to the journal that is synced to disk."
    yield histogram("mrbt_journal_sync_duration_seconds", text, meter.sync_s)
    problem = view.facts.problems.get(view.robot, {}).get(JOURNAL, "")
    text = "Whether its journal has a problem: its disk is full, it is slow, or another one."
    reasons = {"disk_full": DISK_FULL in problem, "slow": problem == SLOW}
    reasons["other"] = bool(problem) and not any(reasons.values())
    yield gauge("mrbt_journal_problem", text, by_name(reasons), "reason")
    yield gauge("mrbt_facts", "Facts that it holds, of all authors.", float(len(view.facts.map)))


def _work(view: AgentView, meter: Meter) -> Iterator[Family]:
    plan, action = view.plan, view.action
    text = "Time to make a plan; its count is that of plans made."
    yield histogram("mrbt_plan_duration_seconds", text, meter.plan_s)
    text = "Status of the mission by this robot's plan."
    yield gauge("mrbt_mission_status", text, _one_of(plan.result if plan else None), "status")
    yield gauge("mrbt_requests", _REQUESTS, _requests(plan), "state")
    text = "Its claims, by phase: claimed, travelling, ready, running."
    yield counter("mrbt_claims", text, meter.claims, "local_task", "phase")
    text = "Outcomes of its local tasks."
    yield counter("mrbt_outcomes", text, meter.outcomes, "local_task", "result")
    running: dict[Labels, float] = {}
    if action is not None:
        running[(task_label(view.mission, action.local_task),)] = time.monotonic() - meter.started_s
    text = "For how long the present local task has been running; none: no sample."
    yield gauge("mrbt_local_task_running_seconds", text, running, "local_task")


def _one_of(status: Status | None) -> dict[Labels, float]:
    """Return 1 for this status and 0 for every other one."""
    return by_name({(status or Status.IDLE).name.lower(): 1.0}, STATUSES)


def _requests(plan: Plan | None) -> dict[Labels, float]:
    """Count the requests that are served, waiting and blocked."""
    waiting = plan.waiting if plan is not None else ()
    blocked = sum(each.is_blocked for each in waiting)
    served = len(plan.evaluation.requests) - len(waiting) if plan is not None else 0
    counts = {"served": max(0, served), "waiting": len(waiting) - blocked, "blocked": blocked}
    return by_name(counts)


def _team(view: AgentView, meter: Meter) -> Iterator[Family]:
    text = "Whether all robots in good standing report this robot's plan."
    yield gauge("mrbt_agreement", text, float(view.agrees()))
    text = "When it began to agree with all, or ceased to, in Unix time."
    yield gauge("mrbt_agreement_changed_timestamp_seconds", text, meter.agreed_since_s)
    peers = {
        robot: State.LEFT
        if robot in view.facts.removed_robots and peer.state is State.DEAD
        else peer.state
        for robot, peer in view.peers.items()
    }
    states = Counter(map(str, peers.values()))
    text = "Other robots by state, as this one sees them."
    yield gauge("mrbt_peers", text, by_name(states, STATES), "state")
    dead = Counter({robot: 0 for robot in view.mission.robots if robot != view.robot})
    for robot, state in peers.items():
        dead[robot_label(view.mission, robot)] += state is State.DEAD
    text = "Whether this robot holds another one for dead (`other`: how many that are not listed)."
    yield gauge("mrbt_peer_dead", text, by_name(dead), "peer")
    text = "How often it began to suspect a robot."
    yield counter("mrbt_suspicions", text, by_name(meter.suspicions), "peer")
    text = "How often it declared a robot dead."
    yield counter("mrbt_deaths_declared", text, by_name(meter.deaths), "peer")


def _traffic(view: AgentView, meter: Meter) -> Iterator[Family]:
    for traffic, way, text in (
        (meter.received, "received", "handed to the agent"),
        (meter.sent, "sent", "sent; what goes to several robots counts once"),
    ):
        for what, counts in (("messages", traffic.messages), ("bytes", traffic.bytes)):
            help_text = f"{what.capitalize()} {text}, by kind."
            yield counter(f"mrbt_{way}_{what}", help_text, by_name(counts), "kind")
    text = "Messages that were refused, by their alleged source, and why."
    refused = refusals_by_class(view.mission, view.refused)
    yield counter("mrbt_refused_messages", text, refused, "source", "reason")
    text = "Messages that were dropped because too many waited."
    yield counter("mrbt_inbox_dropped_messages", text, float(meter.dropped))


def team_page(observer: Observer) -> list[Family]:
    """Return all families of a team as an observer sees it. Must be called in the event loop."""
    return [*_team_robots(observer), *_team_mission(observer), *_team_faults(observer)]


def _team_robots(observer: Observer) -> Iterator[Family]:
    mission = observer.mission
    states = Counter(str(observer.robot_state(robot)) for robot in observer.robots())
    text = "Robots that are known, by state."
    yield gauge("mrbt_team_robots", text, by_name(states, STATES), "state")
    text = "Whether a robot of the mission file is alive or suspect."
    live = {robot: observer.robot_state(robot).is_member for robot in mission.robots}
    yield gauge("mrbt_team_robot_live", text, by_name(live), "robot")
    text = "Whether a robot is at work on a local task of this type."
    working: Counter[Labels] = Counter()
    for robot in observer.robots():
        claim = observer.claim(robot)
        if claim is not None:
            task = task_label(mission, claim.local_task)
            working[(robot_label(mission, robot), task)] += 1
    yield gauge("mrbt_team_robot_working", text, working, "robot", "local_task")
    text = "Whether all robots in good standing report the same plan."
    yield gauge("mrbt_team_agreement", text, float(observer.agreement))
    text = "Whether this observer hears the robots that the robots hear, and holds the same facts."
    yield gauge("mrbt_team_observer_caught_up", text, float(observer.caught_up))
    text = "Sources of which this observer has refused something."
    yield gauge("mrbt_team_refused_sources", text, float(len(observer.refused)))


def _team_mission(observer: Observer) -> Iterator[Family]:
    mission, plan, record = observer.mission, observer.plan, observer.record
    status = record.result or (plan.result if plan is not None else None)
    yield gauge("mrbt_team_mission_status", "Status of the mission.", _one_of(status), "status")
    yield gauge("mrbt_team_requests", _REQUESTS, _requests(plan), "state")
    tasks = Counter(str(task.state) for task in record.task_log.tasks.values())
    text = "Global tasks of the mission, by state."
    yield gauge("mrbt_team_global_tasks", text, by_name(tasks, TASK_STATES), "state")
    text = "Facts of the team, of all authors."
    yield gauge("mrbt_team_facts", text, float(len(observer.facts.map)))
    outcomes: Counter[Labels] = Counter()
    for entry in observer.facts.map:
        if isinstance(entry.record, Outcome):
            result = "success" if entry.record.success else "failure"
            outcomes[(task_label(mission, entry.parts[2]), result)] += 1
    text = "Outcomes that the team remembers; those that matter no more are dropped."
    yield gauge("mrbt_team_outcomes", text, outcomes, "local_task", "result")
    names = {node.subject for node in mission.tree.nodes if node.kind is Kind.CONDITION}
    text = "Whether a condition holds that T_G reads."
    holds = {name: observer.facts.condition(name) for name in names}
    yield gauge("mrbt_team_condition", text, by_name(holds), "condition")


def _team_faults(observer: Observer) -> Iterator[Family]:
    record = observer.record
    faults = {"major": len(record.major), "minor": len(record.minor)}
    text = "Faults that this observer has seen: deaths (major) and lost capabilities (minor)."
    yield counter("mrbt_team_faults", text, by_name(faults), "kind")
    detection_s, takeover_s = Distribution(), Distribution()
    for fault in record.major:
        for durations, after_us in (
            (detection_s, fault.detected_after_us),
            (takeover_s, fault.reassigned_after_us),
        ):
            if after_us is not None and not fault.is_older:
                durations.observe(after_us / 1e6)
    text = "Time from a death until all knew."
    yield histogram("mrbt_team_detection_duration_seconds", text, detection_s)
    text = "Time from a death until another robot had begun what the dead one held."
    yield histogram("mrbt_team_takeover_duration_seconds", text, takeover_s)
