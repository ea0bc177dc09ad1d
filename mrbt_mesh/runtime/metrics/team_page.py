"""What one who watches tells Prometheus of a whole team."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mrbt_mesh.core.bt.tree import Kind, Status
from mrbt_mesh.core.facts.records import Outcome
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.core.observer.task_log import TaskState
from mrbt_mesh.runtime.metrics.families import (
    Distribution,
    Family,
    FamilyKind,
    Labels,
    labelled,
    one_of,
    single,
)
from mrbt_mesh.runtime.metrics.labels import robot_label, task_label
from mrbt_mesh.runtime.metrics.robot_page import STATES, STATUSES, requests_by_state

GAUGE, COUNTER, HISTOGRAM = FamilyKind.GAUGE, FamilyKind.COUNTER, FamilyKind.HISTOGRAM


def team_page(observer: Observer) -> list[Family]:
    """All families of a team as an observer sees it; call it where that may be looked at."""
    return [*_robots(observer), *_mission(observer), *_faults(observer)]


def _robots(observer: Observer) -> Iterator[Family]:
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
    text = "Whether this observer hears whom the robots hear, and holds the same facts."
    yield single(GAUGE, "mrbt_team_observer_caught_up", text, float(observer.caught_up))
    text = "Sources of which this observer has refused something."
    yield single(GAUGE, "mrbt_team_refused_sources", text, float(len(observer.refused)))


def _mission(observer: Observer) -> Iterator[Family]:
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


def _faults(observer: Observer) -> Iterator[Family]:
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
