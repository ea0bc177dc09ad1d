"""What is accepted and what is believed: whether this mission and run have a place for an entry.

`records` has already checked the form of name and value. An entry refused here is not joined, so no
robot can write about conditions, nodes or tasks that the mission does not have.

A team whose mission was revised also keeps entries that the mission in force has no place for, as
they may be about an earlier or later revision. Such an entry is not *believed*: it has no effect
until a revision has a place for it.
"""

from __future__ import annotations

from collections.abc import Container, Iterable
from dataclasses import replace

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, CONTROLS, Kind, Memory
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.activation_facts import OF_PARTIES
from mrbt_mesh.core.facts.conditions import expression_value
from mrbt_mesh.core.facts.jobs import job_in_guard
from mrbt_mesh.core.facts.records import (
    Arguments,
    Attempt,
    Claim,
    ConditionValue,
    ExpressionChanges,
    Job,
    JobEnd,
    MissionResult,
    NoClaim,
    OperatorCommand,
    Overtaken,
    Proposal,
    Record,
    TeamTime,
    TravelTimes,
)
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.mission.jobs import task_of_job, type_at
from mrbt_mesh.core.mission.mission import GlobalTask, Mission, MissionEnd
from mrbt_mesh.core.mission.names import is_argument, is_job_id, is_robot_id

# The number of an archive has fewer digits than this.
MAX_DIGITS = 16
# Kinds of entry that belong to an activation -> the kinds of node that have such activations.
ACTIVATION_KINDS = {
    records.OUTCOME: frozenset({Kind.ACTION}),
    records.LATCHED_FAILURE: frozenset({Kind.ACTION}),
    records.ATTEMPT: ATTEMPT_KINDS,
    records.EXPIRED: frozenset({Kind.TIMEOUT}),
    records.CHILD_RESULT: CONTROLS,
    records.ARGUMENTS: frozenset({Kind.ACTION}),
    **{kind: frozenset({Kind.ACTION}) for each in features() for kind in each.activation_kinds()},
}
_FEATURE_OF = {kind: feature for feature in features() for kind in feature.activation_kinds()}
_OF_NO_ACTIVATION = {kind: feature for feature in features() for kind in feature.other_kinds()}


def refusal_reason(entry: Entry, mission: Mission, run: str) -> str | None:
    """Why a robot that runs this mission refuses this entry; None if it accepts it."""
    if mission.succession is None or entry.parts[0] in records.IN_ANY_MISSION:
        return no_place_reason(entry, mission, run)
    return _refuse_author(entry) or _refuse_in_any_mission(entry, entry.parts, run)


def believed(entry: Entry, mission: Mission, run: str) -> Record | None:
    """The record of an entry while this revision is in force, without what the mission lacks; None
    if nothing remains. A job and its end are known by their id, even if the mission lacks their
    type.
    """
    record = entry.record
    if isinstance(record, Claim | NoClaim):
        return _believed_claim(record, mission, run)
    if isinstance(record, TravelTimes) and mission.travel is not None:
        return _believed_times(record, mission.travel.places)
    value = record.value if isinstance(record, OperatorCommand) else record
    if isinstance(value, Job | JobEnd) and mission.jobs:
        return record
    return record if no_place_reason(entry, mission, run) is None else None


def _believed_claim(record: Claim | NoClaim, mission: Mission, run: str) -> Claim | NoClaim:
    """Remove from a claim an activation or a place that the mission lacks."""
    place = record.place if _refuse_place(record.place, mission) is None else ""
    if isinstance(record, NoClaim) or _refuse_claim(record, mission, run) is not None:
        return NoClaim(place)
    return record if place == record.place else replace(record, place=place)


def _believed_times(record: TravelTimes, places: Container[str]) -> TravelTimes:
    known = [number for number, place in enumerate(record.places) if place in places]
    if len(known) == len(record.places):
        return record
    ways = tuple(tuple(record.ways_ms[a][b] for b in known) for a in known)
    return TravelTimes(tuple(record.places[number] for number in known), ways)


def _refuse_in_any_mission(entry: Entry, parts: tuple[str, ...], run: str) -> str | None:
    """Why no mission of this run can have a place for this entry."""
    if parts[0] in ACTIVATION_KINDS:
        return _refuse_text(parts[1], run) or _malformed(entry, parts)
    if parts[0] == records.JOB_ARCHIVE:
        return _refuse_archive(parts[1])
    if parts[0] in records.JOB_KINDS and not is_job_id(parts[1]):
        return f"{parts[1]!r:.80} names no job"
    return None


def _malformed(entry: Entry, parts: tuple[str, ...]) -> str | None:
    """Why the part of a name that follows the activation cannot be read."""
    if parts[0] in _FEATURE_OF:
        return _FEATURE_OF[parts[0]].malformed(entry) or None
    if parts[0] == records.OUTCOME and len(parts) == 4:
        return _malformed_party(entry)
    if parts[0] == records.CHILD_RESULT and not parts[2].isdecimal():
        return f"{parts[2]!r:.20} is no position of a child"
    return None


def no_place_reason(entry: Entry, mission: Mission, run: str) -> str | None:
    """Why this run of the mission has no place for this entry, or None if it has one."""
    return _refuse_author(entry) or _refuse_by_kind(entry, mission, run)


def _refuse_by_kind(entry: Entry, mission: Mission, run: str) -> str | None:
    parts = entry.parts
    if parts[0] == records.CONDITION:
        return _refuse_condition(entry, parts[1], mission)
    if parts[0] == records.EXPRESSION:
        return _refuse_expression(entry, parts[1], mission)
    if parts[0] in ACTIVATION_KINDS:
        return _refuse_of_activation(entry, parts, mission, run)
    if parts[0] == records.JOB_ARCHIVE:
        return _refuse_archive(parts[1]) if mission.jobs else "this mission has no jobs"
    if parts[0] in records.JOB_KINDS:
        return _refuse_of_job(entry, parts[1], mission)
    if parts[0] in _OF_NO_ACTIVATION:
        return _OF_NO_ACTIVATION[parts[0]].misplaced(entry, mission) or None
    return _refuse_of_robot(entry, mission, run)


def _refuse_of_robot(entry: Entry, mission: Mission, run: str) -> str | None:
    """Check a robot's entry about itself."""
    match entry.record:
        case Proposal() | Overtaken() | TeamTime() as record:
            return _refuse_of_schedules(record, mission, run)
        case Claim() as claim:
            reason = _refuse_claim(claim, mission, run)
            return reason or _refuse_place(claim.place, mission)
        case NoClaim(place):
            return _refuse_place(place, mission)
        case TravelTimes(places):
            if mission.travel is None:
                return "this mission has no places"
            reasons = (_refuse_place(place, mission) for place in places)
            return next((reason for reason in reasons if reason is not None), None)
        case MissionResult() if mission.ends is MissionEnd.NEVER:
            return "this mission never ends"
    return None


def _refuse_author(entry: Entry) -> str:
    """Check that operators write commands and robots everything else. Returns empty if so."""
    kind, *subject = entry.parts
    is_command = isinstance(entry.record, OperatorCommand)
    if is_command is not (entry.author == records.OPERATORS):
        return f"{kind!r} is not for {'robots' if is_command else 'operators'} to write"
    fields = (feature.commands.get(kind) for feature in features())
    is_of_robot = any(field is not None and field.is_of_robot for field in fields)
    if is_of_robot and not is_robot_id(subject[0]):
        return f"{subject[0]!r:.80} is not a robot's id"
    return ""


def _refuse_claim(claim: Claim, mission: Mission, run: str) -> str | None:
    """Check that an action of the tree needs the claimed local task."""
    reason = _refuse_name(records.OUTCOME, claim.activation, mission, run)
    if reason is not None:
        return reason
    task = task_of_activation(parse_activation(claim.activation), mission)
    if task is None or task.need(claim.local_task) is None:
        return f"{claim.activation!r:.80} needs no {claim.local_task!r:.80}"
    return None


def _refuse_archive(number: str) -> str | None:
    if number.isdecimal() and len(number) < MAX_DIGITS:
        return None
    return f"{number!r:.80} is not a number of an archive of jobs"


def _refuse_place(place: str, mission: Mission) -> str | None:
    if not place or (mission.travel is not None and place in mission.travel.places):
        return None
    return f"this mission has no place {place!r:.80}"


def _refuse_condition(entry: Entry, name: str, mission: Mission) -> str | None:
    """Check the value. A boolean alternates, so value and changes must agree."""
    if not mission.entries.can_be_set(name):
        return f"condition {name!r} is not declared, or not of this robot"
    record = entry.record
    assert isinstance(record, ConditionValue)
    if problem := mission.entries.problem(name, record.value):
        return f"{name!r}: {problem}"
    if mission.entries.is_value(name):
        return None
    if record.value != (mission.entries.default(name) ^ bool(record.changes % 2)):
        return f"condition {name!r}: value and count {record.changes} disagree"
    return None


def _refuse_expression(entry: Entry, name: str, mission: Mission) -> str | None:
    """Check that an expression's changes follow from those read, and are at most their sum."""
    expression = mission.entries.expressions.get(name)
    guard = expression or mission.evaluator.with_actions.get(name)
    of_job = mission.entries.expression_of_job(name) if guard is None and mission.jobs else None
    job = job_in_guard(name)
    if of_job is not None:
        expression = guard = of_job
    elif job and guard is None:
        # A guard of a job, which may not be known here yet: use the guard of its type.
        name = name.replace(f"@{job}", "", 1)
        expression = mission.entries.expressions.get(name)
        guard = expression or mission.evaluator.with_actions.get(name)
    if guard is None:
        return f"{name!r:.80} is not a guard of several conditions in this mission's tree"
    record = entry.record
    assert isinstance(record, ExpressionChanges)
    reads_value = any(map(mission.entries.is_value, guard.conditions))
    numbers = [each for each in record.read if isinstance(each, int)]
    fits = len(numbers) == (0 if reads_value else len(record.read))
    fits = fits and len(record.read) == len(guard.conditions)
    if not fits or (not reads_value and sum(numbers) < record.changes):
        return (
            f"expression {name!r}: a count of {record.changes} does not follow from {record.read}"
        )
    if expression is None or reads_value or job:
        return None  # it depends on more: outcomes, a value, or the arguments of the job
    at_first = expression_value(mission, expression, (0,) * len(record.read))
    now = expression_value(mission, expression, record.read)
    if now != at_first ^ bool(record.changes % 2):
        return f"expression {name!r}: value and count {record.changes} disagree"
    return None


def _refuse_of_schedules(
    record: Proposal | Overtaken | TeamTime, mission: Mission, run: str
) -> str | None:
    """Check that every name is that of an action. Each plan finds out if it still lies ahead."""
    if mission.travel is None:
        return "this mission has no schedules"
    names: Iterable[str] = ()
    if isinstance(record, Proposal):
        names = (step.activation for step in record.steps)
    elif isinstance(record, Overtaken):
        names = (record.begun, *record.counts)
    reasons = (_refuse_name(records.OUTCOME, name, mission, run) for name in names)
    return next((reason for reason in reasons if reason is not None), None)


def _refuse_of_activation(
    entry: Entry, parts: tuple[str, ...], mission: Mission, run: str
) -> str | None:
    kind, text = parts[0], parts[1]
    reason = _refuse_name(kind, text, mission, run)
    if reason is not None:
        return reason
    activation = parse_activation(text)
    if kind == records.CHILD_RESULT:
        node = mission.tree.nodes[mission.evaluator.index_of[activation.node, ""]]
        positions = map(str, range(len(node.children)))
        if node.memory is Memory.NONE or parts[2] not in positions:
            return f"{text!r:.80} has no child {parts[2]!r:.20} to remember"
    if isinstance(entry.record, Attempt) and mission.succession is None:
        node = mission.tree.nodes[mission.evaluator.index_of[activation.node, ""]]
        if 0 < mission.evaluator.limit(node.index) <= entry.record.number:
            return f"{text!r:.80} has no attempt {entry.record.number}"
    if ACTIVATION_KINDS[kind] == {Kind.ACTION}:
        task = task_of_activation(activation, mission)
        return _refuse_of_task(entry, parts, task) if task is not None else "no such task"
    return None


def has_activation(mission: Mission, activation: str, run: str) -> bool:
    """True if an action of the mission could have an activation of this name."""
    return _refuse_name(records.OUTCOME, activation, mission, run) is None


def _refuse_name(kind: str, text: str, mission: Mission, run: str) -> str | None:
    """Why this names no activation of this run that an entry of this kind could belong to."""
    reason = _refuse_text(text, run)
    if reason is None and not _could_exist(kind, parse_activation(text), mission):
        return f"{text!r:.80} names no node of this mission's tree"
    return reason


def _refuse_text(text: str, run: str) -> str | None:
    """Why this does not name an activation of this run, whatever its mission."""
    try:
        activation = parse_activation(text)
    except ValueError:
        return f"{text!r:.80} names no activation"
    if activation.run != run:
        return f"{text!r:.80} belongs to another run"
    numbers = (activation.node, activation.turns, *activation.attempts)
    is_named = not activation.job or is_job_id(activation.job)
    if str(activation) != text or min(numbers) < 0 or not is_named:
        return f"{text!r:.80} names no node of this mission's tree"
    return None


def _could_exist(kind: str, activation: Activation, mission: Mission) -> bool:
    """True if some evaluation could use this name for an entry of this kind."""
    nodes, index = mission.tree.nodes, mission.evaluator.index_of.get((activation.node, ""))
    if index is None:
        return False
    node = nodes[index]
    if node.kind not in ACTIVATION_KINDS[kind]:
        return False
    is_of_job = bool(mission.jobs) and type_at(mission, node.index) is not None
    if bool(activation.job) is not is_of_job:
        return False
    if not is_of_job or node.kind is not Kind.ACTION:
        if node.subject != activation.subject:
            return False
    elif task_of_activation(activation, mission) is None:
        return False
    enclosing_loops, outer = 0, node.parent
    while outer >= 0:
        enclosing_loops += nodes[outer].kind in ATTEMPT_KINDS
        outer = nodes[outer].parent
    return len(activation.attempts) == enclosing_loops


def task_of_activation(activation: Activation, mission: Mission) -> GlobalTask | None:
    """The global task of an activation, None if the mission has no such step. A task of the same
    name in another step may have other policies.

    `mission`: as its file declares it. Whether the job exists does not matter.
    """
    if activation.job:
        return task_of_job(mission, activation.node, activation.subject)
    if (activation.node, "") not in mission.evaluator.index_of:
        return None
    return mission.global_tasks.get(activation.subject)


def _refuse_of_job(entry: Entry, name: str, mission: Mission) -> str | None:
    record = entry.record.value if isinstance(entry.record, OperatorCommand) else entry.record
    if not mission.jobs:
        return "this mission has no jobs"
    if not is_job_id(name):
        return f"{name!r:.80} names no job"
    if isinstance(record, Job | JobEnd) and record.type not in mission.jobs:
        return f"this mission has no jobs of type {record.type!r:.80}"
    if isinstance(record, Job | JobEnd):
        return mission.jobs[record.type].problem(record.arguments) or None
    return None


def _refuse_of_task(entry: Entry, parts: tuple[str, ...], task: GlobalTask) -> str | None:
    """Why an activation of this global task has no place for an entry."""
    kind, *names = parts
    if isinstance(entry.record, Arguments):
        values = entry.record.values
        fits = len(values) == len(task.reads) and all(map(is_argument, values))
        return None if fits else f"{task.id!r} reads {', '.join(task.reads) or 'no entries'}"
    local_tasks = {need.local_task for need in task.needs}
    if kind == records.OUTCOME:
        if names[1] not in local_tasks:
            return f"{task.id!r} needs no {names[1]!r:.80}"
        if (len(names) == 3) != (task.joint is not None):
            return f"{task.id!r}: an outcome names a party if robots do the task jointly"
        return _malformed_party(entry) if task.joint is not None else None
    if kind in _FEATURE_OF:
        return _FEATURE_OF[kind].refuses(entry, task) or None
    return None


def _malformed_party(outcome: Entry) -> str | None:
    if OF_PARTIES is None:
        return "no robots do a task jointly"
    return OF_PARTIES.malformed(outcome) or None
