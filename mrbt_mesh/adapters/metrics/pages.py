"""The pages for Prometheus: one robot with the team as it sees it, and a team as it is observed."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator

from mrbt_mesh.adapters.metrics.families import (
    Distribution,
    Family,
    FamilyKind,
    Labels,
    labelled,
    one_of,
    refusals_by_class,
    robot_label,
    single,
    task_label,
)
from mrbt_mesh.adapters.metrics.meter import Meter, Traffic
from mrbt_mesh.core.agent.view import AgentView
from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.facts.records import Outcome
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.task_log import TaskState
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.version import __version__

GAUGE, COUNTER = FamilyKind.GAUGE, FamilyKind.COUNTER
HISTOGRAM, INFO = FamilyKind.HISTOGRAM, FamilyKind.INFO
STATUSES = tuple(status.name.lower() for status in Status)
STATES = tuple(map(str, State))


def robot_page(view: AgentView, meter: Meter) -> list[Family]:
    """All families of one robot; call it in the event loop."""
    return [
        *_itself(view, meter),
        *_work(view, meter),
        *_team(view, meter),
        *_messages(view, meter),
    ]


def _itself(view: AgentView, meter: Meter) -> Iterator[Family]:
    mission = view.mission
    me = (view.robot, mission.name, view.header.run, __version__)
    labels = ("robot", "mission", "run", "version")
    yield Family(INFO, "mrbt_robot", "Which robot this is.", labels, ((me, 1.0),))
    text = "Whether the robot has its place in the team."
    yield single(GAUGE, "mrbt_joined", text, float(not view.is_joining))
    text = "Number of its incarnation: grows when it starts again and when it fences itself."
    yield single(GAUGE, "mrbt_incarnation", text, float(view.incarnation.counter))
    text = "How often it fenced itself after a silence of its own."
    yield single(COUNTER, "mrbt_fencings", text, float(meter.fencings))
    text = "Capabilities that it has lost."
    yield single(GAUGE, "mrbt_lost_capabilities", text, float(len(view.lost)))
    text = "By how much the event loop was late."
    yield single(HISTOGRAM, "mrbt_event_loop_lag_seconds", text, meter.lag_s)
    text = "Time of a write to the journal that is synced to disk."
    yield single(HISTOGRAM, "mrbt_journal_sync_duration_seconds", text, meter.sync_s)
    text = "Facts that it holds, of all authors."
    yield single(GAUGE, "mrbt_facts", text, float(len(view.facts.map)))


def _work(view: AgentView, meter: Meter) -> Iterator[Family]:
    plan, action = view.plan, view.action
    text = "Time to make a plan; its count is that of plans made."
    yield single(HISTOGRAM, "mrbt_plan_duration_seconds", text, meter.plan_s)
    status = plan.result if plan is not None else Status.IDLE
    text = "Status of the mission by this robot's plan."
    yield one_of("mrbt_mission_status", text, "status", STATUSES, status.name.lower())
    text = "Requests of T_G: served, waiting for busy robots, or blocked for lack of robots."
    yield labelled(GAUGE, "mrbt_requests", text, ("state",), requests_by_state(plan).items())
    text = "What it wrote of its work, by phase: claimed, ready, running."
    yield labelled(COUNTER, "mrbt_claims", text, ("local_task", "phase"), meter.claims.items())
    text = "Outcomes of its local tasks."
    yield labelled(COUNTER, "mrbt_outcomes", text, ("local_task", "result"), meter.outcomes.items())
    running: dict[Labels, float] = {}
    if action is not None:
        running[(task_label(view.mission, action.local_task),)] = time.monotonic() - meter.started_s
    text = "For how long the local task has been running that runs now; none: no sample."
    yield labelled(GAUGE, "mrbt_local_task_running_seconds", text, ("local_task",), running.items())


def requests_by_state(plan: Plan | None) -> dict[Labels, float]:
    """How many requests are served, waiting and blocked."""
    waiting = plan.waiting if plan is not None else ()
    blocked = sum(each.is_blocked for each in waiting)
    served = len(plan.evaluation.requests) - len(waiting) if plan is not None else 0
    counts = {"served": max(0, served), "waiting": len(waiting) - blocked, "blocked": blocked}
    return {(state,): float(count) for state, count in counts.items()}


def _team(view: AgentView, meter: Meter) -> Iterator[Family]:
    text = "Whether all robots in good standing report this robot's plan."
    yield single(GAUGE, "mrbt_agreement", text, float(view.agrees()))
    text = "When it began to agree with all, or ceased to, in Unix time."
    name = "mrbt_agreement_changed_timestamp_seconds"
    yield single(GAUGE, name, text, meter.agreed_since_s)
    states = Counter(str(peer.state) for peer in view.peers.values())
    by_state = {(state,): float(states[state]) for state in STATES}
    text = "Other robots by state, as this one sees them."
    yield labelled(GAUGE, "mrbt_peers", text, ("state",), by_state.items())
    dead: Counter[Labels] = Counter({(robot,): 0 for robot in view.mission.robots})
    dead.pop((view.robot,), None)
    for robot, peer in view.peers.items():
        dead[(robot_label(view.mission, robot),)] += peer.state is State.DEAD
    text = "Whether this robot holds another one for dead (`other`: how many that are not listed)."
    yield labelled(GAUGE, "mrbt_peer_dead", text, ("peer",), dead.items())
    for counts, name, text in (
        (meter.suspicions, "mrbt_suspicions", "How often it began to suspect a robot."),
        (meter.deaths, "mrbt_deaths_declared", "How often it declared a robot dead."),
    ):
        by_peer = {(peer,): float(count) for peer, count in counts.items()}
        yield labelled(COUNTER, name, text, ("peer",), by_peer.items())


def _messages(view: AgentView, meter: Meter) -> Iterator[Family]:
    for traffic, way, text in (
        (meter.received, "received", "handed to the agent"),
        (meter.sent, "sent", "sent; what goes to several robots counts once"),
    ):
        yield from _traffic(traffic, way, text)
    text = "Messages that were refused, by where they said they came from, and why."
    labels = ("source", "reason")
    refused = refusals_by_class(view.mission, view.refused)
    yield labelled(COUNTER, "mrbt_refused_messages", text, labels, refused.items())
    text = "Messages that were dropped because too many waited."
    yield single(COUNTER, "mrbt_inbox_dropped_messages", text, float(meter.dropped))


def _traffic(traffic: Traffic, way: str, text: str) -> Iterator[Family]:
    for column, what in enumerate(("messages", "bytes")):
        by_kind = {(kind,): float(each[column]) for kind, each in traffic.by_kind().items()}
        help_text = f"{what.capitalize()} {text}, by kind."
        yield labelled(COUNTER, f"mrbt_{way}_{what}", help_text, ("kind",), by_kind.items())


def team_page(observer: Observer) -> list[Family]:
    """All families of a team as an observer sees it; call it in the event loop."""
    return [*_team_robots(observer), *_team_mission(observer), *_team_faults(observer)]


def _team_robots(observer: Observer) -> Iterator[Family]:
    mission = observer.mission
    text = "Robots that are known, by state."
    states = Counter(str(observer.robot_state(robot)) for robot in observer.robots())
    by_state = {(state,): float(states[state]) for state in STATES}
    yield labelled(GAUGE, "mrbt_team_robots", text, ("state",), by_state.items())
    text = "Whether a robot of the mission file is alive or suspect."
    live = {(r,): float(observer.robot_state(r).is_member) for r in mission.robots}
    yield labelled(GAUGE, "mrbt_team_robot_live", text, ("robot",), live.items())
    text = "Whether a robot is at work on a local task of this type."
    working: Counter[Labels] = Counter()
    for robot in observer.robots():
        claim = observer.claim(robot)
        if claim is not None:
            task = task_label(mission, claim.local_task)
            working[(robot_label(mission, robot), task)] += 1
    yield labelled(GAUGE, "mrbt_team_robot_working", text, ("robot", "local_task"), working.items())
    text = "Whether all robots in good standing report the same plan."
    yield single(GAUGE, "mrbt_team_agreement", text, float(observer.agreement))
    text = "Whether this observer hears the robots that the robots hear, and holds the same facts."
    yield single(GAUGE, "mrbt_team_observer_caught_up", text, float(observer.caught_up))
    text = "Sources of which this observer has refused something."
    yield single(GAUGE, "mrbt_team_refused_sources", text, float(len(observer.refused)))


def _team_mission(observer: Observer) -> Iterator[Family]:
    mission, plan, record = observer.mission, observer.plan, observer.record
    status = record.result or (plan.result if plan is not None else Status.IDLE)
    text = "Status of the mission."
    yield one_of("mrbt_team_mission_status", text, "status", STATUSES, status.name.lower())
    text = "Requests of T_G: served, waiting for busy robots, or blocked for lack of robots."
    yield labelled(GAUGE, "mrbt_team_requests", text, ("state",), requests_by_state(plan).items())
    tasks = Counter(str(task.state) for task in record.task_log.tasks.values())
    by_state = {(str(state),): float(tasks[str(state)]) for state in TaskState}
    text = "Global tasks of the mission, by state."
    yield labelled(GAUGE, "mrbt_team_global_tasks", text, ("state",), by_state.items())
    text = "Facts of the team, of all authors."
    yield single(GAUGE, "mrbt_team_facts", text, float(len(observer.facts.map)))
    outcomes: Counter[Labels] = Counter()
    for entry in observer.facts.map:
        if isinstance(entry.record, Outcome):
            result = "success" if entry.record.success else "failure"
            outcomes[(task_label(mission, entry.parts[2]), result)] += 1
    text = "Outcomes that the team remembers; those that matter no more are dropped."
    labels = ("local_task", "result")
    yield labelled(GAUGE, "mrbt_team_outcomes", text, labels, outcomes.items())
    leaves = (node for node in mission.tree.nodes if node.kind is Kind.CONDITION)
    names = dict.fromkeys(node.subject for node in leaves)
    text = "Whether a condition holds that T_G reads."
    conditions = {(name,): float(observer.facts.condition(name)) for name in names}
    yield labelled(GAUGE, "mrbt_team_condition", text, ("condition",), conditions.items())


def _team_faults(observer: Observer) -> Iterator[Family]:
    record = observer.record
    faults = {("major",): float(len(record.major)), ("minor",): float(len(record.minor))}
    text = "Faults that this observer has seen: deaths (major) and lost capabilities (minor)."
    yield labelled(COUNTER, "mrbt_team_faults", text, ("kind",), faults.items())
    detection_s, takeover_s = Distribution(), Distribution()
    for fault in record.major:
        for durations, at_us in (
            (detection_s, fault.detected_us),
            (takeover_s, fault.reassigned_us),
        ):
            if at_us is not None:
                durations.observe(max(0, at_us - fault.at_us) / 1e6)
    text = "Time from a death until all knew."
    yield single(HISTOGRAM, "mrbt_team_detection_duration_seconds", text, detection_s)
    text = "Time from a death until another robot had begun what the dead one held."
    yield single(HISTOGRAM, "mrbt_team_takeover_duration_seconds", text, takeover_s)
