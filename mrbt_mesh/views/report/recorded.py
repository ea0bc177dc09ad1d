"""Computes the figures of a run from its recording."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from mrbt_mesh.core.mission.names import name_order
from mrbt_mesh.formats.expand import call_text
from mrbt_mesh.observer.job_history import JobHistory
from mrbt_mesh.observer.job_rows import HELD, RUNNING, WAITING, JobRows
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.observer.work_log import WorkEnd, WorkSpan
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording
from mrbt_mesh.views.report.history import History
from mrbt_mesh.views.report.model import (
    ReportedFault,
    ReportedJob,
    ReportedWork,
    RobotUse,
    RunIdentity,
    RunReport,
    ScheduledTask,
    TaskEnd,
    Wait,
    WaitKind,
)
from mrbt_mesh.views.report.summaries import reported_failures

AGREED = "until all had agreed on the plan"
NOT_READY = "its partners were not there yet"
ON_WAY = "it went to its place, and waited for its partners there if it has any"


def report_recording(
    recording: Recording,
    title: str,
    told: RunReport | None = None,
    died_us: Mapping[str, int] | None = None,
    *,
    is_continued: bool = False,
) -> RunReport:
    """Play the recording once and count. Raises RecordingError if it is damaged.

    `told`: the run's summary, which also knows its end and deaths that nobody saw. `died_us`:
    robots that others saw die, and their last signs of life. `is_continued`: the recording began
    later than the run.
    """
    player, history = Player(recording), History()
    record = player.observer.record
    for at_us in sorted(set(recording.records.times_us)):
        player.seek(at_us)
        if record.ended_us is None:
            history.look(player.observer, at_us)
    if told is not None:
        _add_unseen(record, told, player.end_us, is_continued)
    for name, at_us in (died_us or {}).items():
        record.died_unseen(name, player.end_us, at_us)
    end_us = player.end_us if record.ended_us is None else record.ended_us
    end_us = max([end_us, *(f.at_us for f in record.major if record.result is None)])
    history.end(end_us)
    summary = player.summary()
    result = summary["result"] if told is None else told.result
    states = {each.robot: each.state for each in told.robots} if told is not None else {}
    robot = recording.metadata.robot
    notes = [_seen_by(recording)] * bool(robot)
    notes += [f"{recording.name}: {x}" for x in (recording.torn, recording.begins_late) if x]
    if record.started_us is None:
        notes.append("no robot had joined")
        return RunReport(title, summary["mission"], result, 0.0, notes=tuple(notes))
    start_us = record.started_us
    spans = record.work_log.spans
    waits = [*history.waits(start_us), *_starts(spans, start_us, end_us)]
    return RunReport(
        title,
        summary["mission"],
        result,
        max(summary["duration_s"], record.seconds(end_us) or 0.0),
        tuple(
            _use(record, name, history, end_us, states.get(name))
            for name in sorted(record.joined_us)
        ),
        _faults(record, history),
        tuple(
            TaskEnd(name, task["status"], tuple(task["robots"]))
            for name, task in summary["global_tasks"].items()
        ),
        tuple(_work(span, start_us, end_us) for span in spans if span.claimed_us <= end_us),
        tuple(sorted(waits, key=lambda wait: (wait.from_s, wait.kind, wait.who))),
        None if robot else history.plans_held.plans(start_us),
        None if robot else history.differences(start_us),
        notes=tuple(notes),
        failures=reported_failures(summary),
        identity=_identity(recording, start_us),
        scheduled=_scheduled(history, spans, start_us),
        jobs=_jobs(player.observer),
    )


def _seen_by(recording: Recording) -> str:
    """Return the note on a report that is a robot's view."""
    where = "nobody recorded what others reported of their plans"
    if recording.metadata.is_observed:
        where = "what others reported of their plans is in the observer's recording"
    return f"as {recording.metadata.robot} saw it; {where}"


def _jobs(observer: Observer) -> tuple[ReportedJob, ...]:
    """Return the jobs at the end of the recording; of older ones times may not be known."""
    record = observer.record
    found = []
    for row in JobRows().of(observer):
        known = record.job_log.jobs.get(row.id)
        history = known or JobHistory()
        has_ended = known is not None and row.state not in (HELD, WAITING, RUNNING)
        ended_us = record.job_log.ended_us(history) if has_ended else None
        found.append(
            ReportedJob(
                row.id,
                call_text(row.type, map(str, row.arguments.values())),
                row.priority,
                record.seconds(history.submitted_us),
                record.seconds(history.begun_us),
                record.seconds(ended_us),
                row.robots,
                row.state,
                row.why,
                row.operator,
            )
        )
    # Those of unknown times were there before the recording.
    return tuple(sorted(found, key=lambda job: (job.submitted_s or -math.inf, name_order(job.id))))


def _scheduled(
    history: History, spans: Iterable[WorkSpan], start_us: int
) -> tuple[ScheduledTask, ...]:
    """Return predicted and actual times of tasks, by the expected begin."""
    works: dict[str, list[WorkSpan]] = {}
    for span in spans:
        works.setdefault(span.activation, []).append(span)
    found = []
    for activation, (at_us, author, steps) in history.scheduled.items():
        step, known_s = next(iter(steps.values())), (at_us - start_us) / 1e6
        done = [work for work in works.get(activation, ()) if work.end is WorkEnd.DONE]
        begun_us = [w.running_us for w in works.get(activation, ()) if w.running_us is not None]
        ended_us = [work.ended_us for work in done if work.ended_us is not None]
        found.append(
            ScheduledTask(
                step.global_task,
                author,
                known_s,
                tuple(steps),
                known_s + step.begins_s,
                known_s + step.ends_s,
                tuple(sorted({work.robot for work in done})),
                (min(begun_us) - start_us) / 1e6 if begun_us else None,
                (max(ended_us) - start_us) / 1e6 if ended_us else None,
            )
        )
    return tuple(sorted(found, key=lambda each: (each.begins_s, each.name)))


def _identity(recording: Recording, start_us: int) -> RunIdentity:
    said = recording.metadata
    began_unix_s = said.epoch_ns / 1e9 + start_us / 1e6 if said.epoch_ns else None
    return RunIdentity(began_unix_s, said.run, said.mission_digest, said.version)


def _work(span: WorkSpan, start_us: int, end_us: int) -> ReportedWork:
    running = span.running_us is not None and span.running_us <= end_us
    ended_us = end_us if span.ended_us is None else min(span.ended_us, end_us)
    return ReportedWork(
        span.robot,
        span.global_task,
        span.local_task,
        (span.claimed_us - start_us) / 1e6,
        (span.running_us - start_us) / 1e6 if running and span.running_us is not None else None,
        (ended_us - start_us) / 1e6,
        None if span.end is None else str(span.end),
    )


def _starts(spans: Sequence[WorkSpan], start_us: int, end_us: int) -> list[Wait]:
    """Return the waits of robots with a claim that could not start, e.g. for partners that claimed
    later.
    """
    found = []
    for span in spans:
        until_us = min(x for x in (span.running_us, span.ended_us, end_us) if x is not None)
        if until_us <= span.claimed_us:
            continue
        later = {
            other.robot
            for other in spans
            if other.activation == span.activation
            and other.robot != span.robot
            and span.claimed_us < other.claimed_us <= until_us
        }
        waits = NOT_READY if later else AGREED
        found.append(
            Wait(
                WaitKind.START,
                span.robot,
                (span.claimed_us - start_us) / 1e6,
                (until_us - start_us) / 1e6,
                f"{span.local_task} for {span.global_task}: {ON_WAY if span.is_way else waits}",
                tuple(sorted(later)),
            )
        )
    return found


def _faults(record: RunRecord, history: History) -> tuple[ReportedFault, ...]:
    major = [
        ReportedFault(
            fault.robot,
            record.seconds(fault.at_us) or 0.0,
            record.seconds(fault.until_us),
            (),
            fault.detected_after_us,
            fault.reassigned_after_us,
            fault.held.local_task if fault.held else None,
            fault.replacement,
            history.takeovers.get(index, ""),
            exact=fault.exact,
        )
        for index, fault in enumerate(record.major)
    ]
    minor = [
        ReportedFault(
            fault.robot,
            record.seconds(fault.at_us) or 0.0,
            record.seconds(fault.until_us),
            fault.local_tasks,
            reason=fault.reason,
        )
        for fault in record.minor
    ]
    return tuple(sorted([*major, *minor], key=lambda fault: (fault.at_s, fault.robot)))


def _add_unseen(record: RunRecord, told: RunReport, now_us: int, is_continued: bool) -> None:
    """Add the deaths of the summary that no observer saw, as where all robots were killed."""
    if record.started_us is None:
        return
    # The summary may count from the begin of the whole run, and ends with this part of it.
    later_s = told.duration_s - (record.seconds(now_us) or 0.0) if is_continued else 0.0
    for fault in told.deaths:
        at_s = fault.at_s - max(0.0, later_s)
        if fault.until_s is None and at_s >= 0:
            record.died_unseen(fault.robot, now_us, record.started_us + round(at_s * 1e6))


def _use(
    record: RunRecord, robot: str, history: History, end_us: int, told: str | None
) -> RobotUse:
    """Return how a robot spent its time; `told`: its state in the summary."""
    away = [
        *history.left_us(robot),
        *((f.at_us, f.until_us or end_us) for f in record.major if f.robot == robot),
    ]
    joined_us = record.joined_us[robot]
    spans = [span for span in record.work_log.spans if span.robot == robot]
    present = without([(joined_us, max(joined_us, end_us))], away)
    ended = [(span, span.ended_us if span.ended_us is not None else end_us) for span in spans]
    worked = [(s.running_us, to_us) for s, to_us in ended if s.running_us is not None]
    starting = [
        (s.claimed_us, to_us if s.running_us is None else s.running_us) for s, to_us in ended
    ]
    about = record.robots[robot]
    return RobotUse(
        robot,
        str(about.get("type") or ""),
        told or str(about.get("state") or ""),
        _length_s(present),
        _length_s(_both(present, worked)),
        _length_s(_both(present, starting)),
        sum(span.end is WorkEnd.DONE for span in spans),
    )


def without(spans: list[tuple[int, int]], cut: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return what is left of time spans after cutting others; all as (from, to)."""
    for begin, end in cut:
        if end > begin:
            spans = [
                part
                for a, b in spans
                for part in ((a, min(b, begin)), (max(a, end), b))
                if part[1] > part[0]
            ]
    return spans


def _both(first: list[tuple[int, int]], second: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the intersection of two lists of spans; the spans of each do not overlap."""
    met = ((max(a, c), min(b, d)) for a, b in first for c, d in second)
    return [span for span in met if span[1] > span[0]]


def _length_s(spans: list[tuple[int, int]]) -> float:
    return sum(end - begin for begin, end in spans) / 1e6
