"""Judges what robots put off, from where they were and what they did, as they recorded it.

Written from docs/how-to/looking-ahead.md and docs/how-to/jobs.md. It computes by geometry when a
robot could have ended a job, and holds that against when the job ended. It imports nothing of the
product, and of the other judge only what was handed in.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from benchmarks.task_order_judge import AGREED_S, DETECTED_S, KNOWN_S, Handed, job_of

# Agreement, and gains that are too small to change a schedule for.
SLACK_S = 1.5
Point = tuple[float, float]


@dataclass(frozen=True)
class Stretch:
    """What a robot did from one time to another: nothing, drive or work. `at`: where it was in the
    beginning.
    """

    from_s: float
    to_s: float
    job: str
    is_way: bool
    at: Point

    @property
    def is_idle(self) -> bool:
        """Whether it had nothing to do."""
        return not self.job


@dataclass(frozen=True)
class Area:
    """Where places are, where robots started, and how fast they drive."""

    places: Mapping[str, Point]
    start: Mapping[str, str]
    speed: float

    def way_s(self, origin: Point, place: str) -> float:
        """How long a robot drives."""
        return math.dist(origin, self.places[place]) / self.speed


@dataclass(frozen=True)
class Stream:
    """What was handed in, what each robot did, when jobs ended and robots were killed."""

    jobs: Sequence[Handed]
    history: Mapping[str, Sequence[Stretch]]
    ended: Mapping[str, float]
    killed_s: Mapping[str, float]
    area: Area

    def able(self, job: Handed) -> list[str]:
        """The robots that were never killed and can do a job."""
        return sorted(job.able - self.killed_s.keys())


def delays(
    jobs: Sequence[Handed],
    events: Iterable[Mapping[str, Any]],
    killed_s: Mapping[str, float],
    area: Area,
) -> list[str]:
    """What was put off without a reason, and robots that turned round more than once."""
    ordered = sorted(events, key=lambda each: float(each["t"]))
    until_s = float(ordered[-1]["t"]) if ordered else 0.0
    history = {
        name: _stretches([e for e in ordered if e["robot"] == name], area.places[at], area, until_s)
        for name, at in area.start.items()
    }
    ended = _ended(jobs, ordered)
    stream = Stream(jobs, history, ended, killed_s, area)
    quiet = [
        job
        for job in jobs
        if job.count == 1
        and job.id in ended
        and not any(
            job.at_s < at_s + DETECTED_S and at_s < ended[job.id] for at_s in killed_s.values()
        )
    ]
    return _idle(quiet, stream) + _late(stream) + _turned(ordered, stream)


def _ended(jobs: Sequence[Handed], events: Iterable[Mapping[str, Any]]) -> dict[str, float]:
    counts, ended = {job.id: job.count for job in jobs}, dict[str, float]()
    for event in events:
        if event["event"] == "end" and event["outcome"] == "success":
            job = job_of(event["activation"])
            counts[job] -= 1
            if not counts[job]:
                ended[job] = float(event["t"])
    return ended


def _stretches(
    events: Sequence[Mapping[str, Any]], here: Point, area: Area, until_s: float
) -> list[Stretch]:
    """What one robot did, without gaps."""
    found, since_s, job, goal = list[Stretch](), 0.0, "", ""
    for event in events:
        at_s, what = float(event["t"]), event["event"]
        there = here
        if goal:
            whole_s = area.way_s(here, goal)
            part = min(1.0, (at_s - since_s) / whole_s) if whole_s else 1.0
            (ax, ay), (bx, by) = here, area.places[goal]
            there = ax + (bx - ax) * part, ay + (by - ay) * part
        found.append(Stretch(since_s, at_s, job, bool(goal), here))
        since_s, here = at_s, there
        is_begun = what in ("start", "begin")
        job = job_of(event["activation"]) if is_begun else ""
        goal = str(event.get("place") or "") if what == "start" else ""
    return [*found, Stretch(since_s, until_s, job, bool(goal), here)]


def _at(history: Sequence[Stretch], at_s: float) -> Stretch:
    return next((each for each in history if each.from_s <= at_s < each.to_s), history[-1])


def _idle(quiet: Sequence[Handed], stream: Stream) -> list[str]:
    """Robots that had nothing to do for as long as they needed to end a job earlier to which nobody
    was on the way.
    """
    found = []
    for job in quiet:
        gaps = _gaps(job, stream)
        idle = [
            (robot, each)
            for robot in stream.able(job)
            for each in stream.history[robot]
            if each.is_idle and not _waits(each, stream)
        ]
        for (robot, each), (open_s, taken_s) in product(idle, gaps):
            from_s = max(each.from_s, open_s) + KNOWN_S
            could_s = from_s + stream.area.way_s(each.at, job.place) + job.work_s
            if (
                from_s < taken_s
                and could_s < each.to_s
                and could_s + SLACK_S < stream.ended[job.id]
            ):
                text = f"{robot} was idle from {from_s:.2f} and could have ended {job.id}"
                found.append(f"{text} at {could_s:.2f}, not at {stream.ended[job.id]:.2f}")
    return found


def _gaps(job: Handed, stream: Stream) -> list[tuple[float, float]]:
    """From when to when nobody was on the way to a job, or at work on it."""
    found, open_s, ended_s = [], job.at_s, stream.ended[job.id]
    done = (stretch for each in stream.history.values() for stretch in each)
    taken = sorted((s.from_s, s.to_s) for s in done if s.job == job.id)
    for from_s, to_s in [*taken, (ended_s, ended_s)]:
        if from_s > open_s:
            found.append((open_s, from_s))
        open_s = max(open_s, to_s)
    return found


def _waits(idle: Stretch, stream: Stream) -> bool:
    """Whether it may have waited for its partner, at the place of a task for several robots."""
    return any(
        job.count > 1
        and math.dist(stream.area.places[job.place], idle.at) < 0.5
        and job.at_s < idle.to_s
        and stream.ended.get(job.id, idle.from_s + 1) > idle.from_s
        for job in stream.jobs
    )


def _late(stream: Stream) -> list[str]:
    """Jobs beside which no other of as much priority was open, for which nobody set out at once, or
    whose deadline was missed, although a robot was free or on its way to a job of less priority.
    """
    found, jobs, ended = [], stream.jobs, stream.ended
    priorities = {job.id: job.priority for job in jobs}
    for job in jobs:
        at_s = job.at_s + KNOWN_S
        if job.count > 1 or _is_near_death(at_s, stream.killed_s):
            continue
        free = [
            stretch
            for robot in stream.able(job)
            if (stretch := _at(stream.history[robot], at_s)).is_idle
            or (stretch.is_way and priorities[stretch.job] < job.priority)
        ]
        could_s = min((at_s + stream.area.way_s(s.at, job.place) for s in free), default=math.inf)
        could_s += job.work_s
        if any(
            other.id != job.id
            and other.priority >= job.priority
            and other.at_s < could_s
            and ended.get(other.id, math.inf) > job.at_s
            for other in jobs
        ):
            continue
        begins = [s.from_s for all_ in stream.history.values() for s in all_ if s.job == job.id]
        must_s = math.inf if job.deadline_s is None else job.deadline_s
        if could_s + SLACK_S < must_s < ended.get(job.id, math.inf):
            found.append(f"{job.id} missed {must_s:.2f}, and could have ended at {could_s:.2f}")
        if free and could_s < must_s and min(begins, default=math.inf) > at_s + SLACK_S:
            found.append(f"nobody set out for {job.id}, of the highest priority, at {at_s:.2f}")
    return found


def _is_near_death(at_s: float, killed_s: Mapping[str, float]) -> bool:
    return any(-10 < at_s - dead_s < DETECTED_S + 1 for dead_s in killed_s.values())


def _turned(events: Sequence[Mapping[str, Any]], stream: Stream) -> list[str]:
    """Robots that turned round to another place more than once before they worked, not for
    priority, from jobs that nobody else then set out for.
    """
    known = {job.id: job for job in stream.jobs}
    starts = [
        (float(e["t"]), e["robot"], job_of(e["activation"]))
        for e in events
        if e["event"] == "start"
    ]
    found, turns = list[str](), dict[str, list[str]]()
    # Robot -> the job to which it is on its way and since when; when and from what it turned.
    way: dict[str, tuple[float, str]] = {}
    left: dict[str, tuple[float, str]] = {}
    for event in events:
        at_s, robot, job = float(event["t"]), event["robot"], job_of(event["activation"])
        if event["event"] == "cancel":
            since_s, goal = way.pop(robot, (at_s, ""))
            # What it gives up at once was begun by a plan that news has overtaken.
            if at_s - since_s > AGREED_S:
                left[robot] = at_s, goal
            continue
        if event["event"] != "start" or not event.get("place"):
            turns.pop(robot, None)
            continue
        way[robot] = at_s, job
        gone_s, gone = left.pop(robot, (0.0, ""))
        if not gone or known[gone].place == known[job].place:
            continue
        is_taken = any(
            other == gone and who != robot and abs(begun_s - gone_s) < AGREED_S
            for begun_s, who, other in starts
        )
        is_excused = is_taken or known[job].priority > known[gone].priority
        if (
            is_excused
            or _is_over(known[gone], at_s, stream)
            or _is_near_death(at_s, stream.killed_s)
        ):
            continue
        turns.setdefault(robot, []).append(f"{gone} to {job} at {at_s:.2f}")
        if len(turns[robot]) > 1:
            found.append(f"{robot} turned round again: {', '.join(turns[robot])}")
    return found


def _is_over(job: Handed, at_s: float, stream: Stream) -> bool:
    """Whether it has ended, or has expired: at its deadline, or as soon as a robot saw that."""
    expires_s = math.inf if job.deadline_s is None else job.deadline_s
    return min(stream.ended.get(job.id, math.inf), expires_s) < at_s
