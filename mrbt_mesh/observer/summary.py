"""The summary of a run, as `up` and `sim` print and write it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrbt_mesh.core.facts.records import JobState, TeamOrder
from mrbt_mesh.core.mission.mission import MICRO, MissionEnd
from mrbt_mesh.observer.episodes import MajorFault
from mrbt_mesh.observer.job_history import OPEN, JobTotals, Times
from mrbt_mesh.observer.job_rows import why_over
from mrbt_mesh.observer.newest import Newest
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.run_record import RunRecord

ABORTED = "an operator has aborted it"


def run_summary(observer: Observer, result: str, now_us: int) -> dict[str, Any]:
    """The summary of the run as plain data; `result` is the observer's word for it.

    `faults`: `at_s` is null where nobody saw when a robot died, and nothing recorded it.
    `takeovers`: `detected_s` and `reassigned_s` count from the fault; null: never. `exact`: from
    the end of the robot's process, not from its last sign of life. `older`: how many more rounds,
    failures and rows of features there were than are listed, if any; the recording has them.
    `jobs`, where the mission has any, by type: how many have come to which end, the means and
    maxima of times (`JobTotals`), and on how many each robot has worked.
    """
    record = observer.record
    lists: dict[str, Newest[Any]] = {
        "rounds": record.rounds.all,
        "failures": record.failures,
        **{each.name: each.rows for each in record.features},
    }
    older = {name: each.dropped for name, each in lists.items() if each.dropped}
    seconds = record.seconds
    faults: list[dict[str, Any]] = [
        {"kind": "major", "robot": fault.robot} | _during(record, _died_us(fault), fault.until_us)
        for fault in record.major
    ]
    faults += [
        {
            "kind": "minor",
            "robot": fault.robot,
            "local_tasks": list(fault.local_tasks),
            "reason": fault.reason,
            **_during(record, fault.at_us, fault.until_us),
        }
        for fault in record.minor
    ]
    return {
        "mission": record.mission.name,
        "result": result,
        "duration_s": seconds(record.ended_us if record.ended_us is not None else now_us),
        **_rounds(record, now_us),
        "robots": {name: _robot(record.robots[name]) for name in sorted(record.robots)},
        "global_tasks": {
            name: {"status": str(task.state), "robots": sorted(task.robots)}
            for name, task in record.task_log.tasks.items()
        },
        **_jobs(observer),
        "faults": sorted(faults, key=lambda fault: (fault["at_s"] or 0, fault["robot"])),
        "blocked": [
            {
                "request": episode.request,
                "reason": episode.reason,
                "from": seconds(episode.from_us),
                "to": seconds(episode.to_us),
            }
            for episode in record.blocked
        ],
        "failures": [
            {
                "robot": end.robot,
                "global_task": end.global_task,
                "local_task": end.local_task,
                "at_s": seconds(end.at_us),
                "reason": end.reason,
            }
            for end in record.failures
        ],
        "problems": [
            {
                "robot": robot,
                "subject": subject,
                **_during(record, episode.from_us, episode.to_us),
                "problem": episode.problem,
            }
            for (robot, subject), episode in record.problems.items()
        ],
        **{each.name: each.to_json(seconds) for each in record.features},
        **({"older": older} if older else {}),
        **({"ended_because": ABORTED} if observer.facts.order() is TeamOrder.ABORT else {}),
        "takeovers": [
            {
                "robot": fault.robot,
                "at_s": seconds(_died_us(fault)),
                "detected_s": _seconds(fault.detected_after_us),
                "reassigned_s": _seconds(fault.reassigned_after_us),
                "exact": fault.exact,
                "held": fault.held.local_task if fault.held else None,
                "replacement": fault.replacement,
            }
            for fault in record.major
        ],
    }


def _died_us(fault: MajorFault) -> int | None:
    return None if fault.is_older else fault.at_us


def _during(record: RunRecord, from_us: int | None, to_us: int | None) -> dict[str, Any]:
    return {"at_s": record.seconds(from_us), "until_s": record.seconds(to_us)}


def _seconds(after_us: int | None) -> float | None:
    return None if after_us is None else round(after_us / 1e6, 6)


def _rounds(record: RunRecord, now_us: int) -> dict[str, Any]:
    """The rounds of a mission that never ends; `to_s` and `result` are null for one on its way."""
    if record.mission.ends is MissionEnd.ONCE:
        return {}
    rounds = [
        {
            "from_s": record.seconds(each.from_us),
            "to_s": record.seconds(each.to_us),
            "duration_s": round(((each.to_us or now_us) - each.from_us) / 1e6, 6),
            "result": None if each.result is None else each.result.name.lower(),
            "robots": sorted(each.robots),
        }
        for each in record.rounds.all
    ]
    return {"ends": str(record.mission.ends), "rounds": rounds}


def _jobs(observer: Observer) -> dict[str, Any]:
    """Of the jobs that were seen. Nobody does open ones once the mission is over or aborted."""
    if not observer.mission.jobs:
        return {}
    is_over, totals = bool(why_over(observer)), observer.record.job_log.totals()
    return {"jobs": {kind: _totals(each, is_over) for kind, each in totals.items()}}


def _totals(totals: JobTotals, is_over: bool) -> dict[str, Any]:
    states = {str(state): totals.states[state] for state in JobState} | {OPEN: totals.states[OPEN]}
    if is_over:
        states[JobState.CANCELLED] += states[OPEN]
        states[OPEN] = 0
    return states | {
        "waited_s": _times(totals.waits),
        "worked_s": _times(totals.works),
        "late": totals.delays.count,
        "late_s": _times(totals.delays),
        "robots": dict(sorted(totals.robots.items())),
    }


def _times(times: Times) -> dict[str, float | None]:
    mean_us = times.all_us // times.count if times.count else None
    return {"mean": _seconds(mean_us), "most": _seconds(times.most_us if times.count else None)}


def _robot(known: Mapping[str, Any]) -> dict[str, Any]:
    state = known.get("state")
    return {
        "type": known.get("type"),
        "state": str(state) if state else None,
        "lost": dict(known.get("lost", {})),
        "pending": dict(known.get("pending", {})),
        "performances": {name: v / MICRO for name, v in known.get("performances", {}).items()},
        "pid": known.get("pid"),
    }
