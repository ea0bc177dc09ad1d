"""Judges the order in which robots did jobs, from what they recorded themselves.

Written from docs/how-to/looking-ahead.md and docs/how-to/jobs.md. It reads events (`start`,
`begin`, `cancel`, `end`), what was handed in, and when robots were killed; it imports nothing of
the product.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

# Until all know of a job that was handed in, and until a robot that was killed is known to be dead.
KNOWN_S, DETECTED_S = 0.5, 4.0
# What robots begin within so long of one another, they begin by one plan.
AGREED_S = 0.2


@dataclass(frozen=True)
class Handed:
    """A job, its priority, and which robots can do it, `count` of them together.

    `at_s`: when it was handed in. `deadline_s`: None without.
    """

    id: str
    at_s: float
    priority: int
    able: frozenset[str]
    count: int = 1
    deadline_s: float | None = None
    place: str = ""
    work_s: float = 0.0


@dataclass
class Verdict:
    """`broken`: what must not be. `overtaken`: by job. `turns`: ways that were broken off for
    something else; `turns_back`: for what the robot had turned away from before. `missed`:
    deadlines, by priority. `passed`: by job, when which robot began what before it.
    """

    broken: list[str] = field(default_factory=list)
    overtaken: Counter[str] = field(default_factory=Counter)
    turns: int = 0
    turns_back: int = 0
    missed: Counter[int] = field(default_factory=Counter)
    done: int = 0
    passed: dict[str, list[tuple[float, str, str]]] = field(default_factory=dict)


class _Robot:
    """What one robot is doing, as its events say. `cancelled`: the job to which it was on its way
    last; `turned`: all such jobs since it ended one. `dropped`: what it gave up last, and when.
    `ended_s`: when it ended something last.
    """

    def __init__(self) -> None:
        self.job = self.cancelled = ""
        self.dropped = "", 0.0
        self.ended_s = -AGREED_S
        self.is_on_its_way = False
        self.turned: set[str] = set()

    def follow(self, event: Mapping[str, Any], job: str, is_open: bool) -> None:
        """Take in one of its events."""
        if event["event"] in ("start", "begin"):
            is_way = event["event"] == "start" and bool(event.get("place"))
            self.job, self.is_on_its_way, self.cancelled = job, is_way, ""
            return
        if event["event"] == "cancel":
            self.dropped = job, float(event["t"])
        if event["event"] == "cancel" and self.is_on_its_way and is_open:
            self.cancelled = job
        elif event["event"] == "end":
            self.turned.clear()
            self.ended_s = float(event["t"])
        self.job, self.is_on_its_way = "", False


def judge(
    jobs: Sequence[Handed],
    events: Iterable[Mapping[str, Any]],
    killed_s: Mapping[str, float],
    most_overtaken: int,
) -> Verdict:
    """What was wrong with a run; `killed_s`: robot -> when it was killed."""
    known, found = {job.id: job for job in jobs}, Verdict()
    robots = {name: _Robot() for job in jobs for name in job.able}
    successes: Counter[str] = Counter()
    ended: dict[str, float] = {}
    ordered = sorted(events, key=lambda each: float(each["t"]))
    starts: dict[str, list[tuple[float, str]]] = {}
    for event in ordered:
        if event["event"] in ("start", "begin"):
            begun = float(event["t"]), event["robot"]
            starts.setdefault(job_of(event["activation"]), []).append(begun)
    given_up: dict[tuple[str, str], list[float]] = {}
    for event in ordered:
        if event["event"] == "cancel":
            key = event["robot"], job_of(event["activation"])
            given_up.setdefault(key, []).append(float(event["t"]))
    for event in ordered:
        at_s, name, what = float(event["t"]), event["robot"], event["event"]
        robot, job = robots[name], job_of(event["activation"])
        # A coalition that is formed anew goes on with the same.
        is_again = robot.dropped[0] == job and at_s - robot.dropped[1] <= AGREED_S
        # What it gives up at once was begun by a plan that news has overtaken.
        is_brief = any(0 <= gone_s - at_s <= AGREED_S for gone_s in given_up.get((name, job), ()))
        if what == "start" and job != robot.job and not is_again and not is_brief:
            begun_with = {
                other: {who for when_s, who in each if 0 <= when_s - at_s <= AGREED_S}
                for other, each in starts.items()
            }
            later = sorted(
                (when_s, who, other)
                for other, each in starts.items()
                for when_s, who in each
                if when_s > at_s
            )
            next_jobs = {who: other for _, who, other in reversed(later)}
            about = ended, killed_s, begun_with, next_jobs
            _begins(found, known, robots, about, (at_s, name, job), most_overtaken)
        robot.follow(event, job, is_open=job not in ended)
        if what == "end":
            successes[job] += event["outcome"] == "success"
            if successes[job] >= known[job].count:
                ended.setdefault(job, at_s)
    for handed in jobs:
        end_s = ended.get(handed.id)
        if handed.deadline_s is None and end_s is None:
            found.broken.append(f"{handed.id} was never done")
        elif handed.deadline_s is not None and (end_s is None or end_s > handed.deadline_s):
            found.missed[handed.priority] += 1
    found.done = len(ended)
    return found


def _begins(
    found: Verdict,
    known: Mapping[str, Handed],
    robots: Mapping[str, _Robot],
    about: tuple[
        Mapping[str, float], Mapping[str, float], Mapping[str, set[str]], Mapping[str, str]
    ],
    event: tuple[float, str, str],
    most_overtaken: int,
) -> None:
    """A robot sets out for a job, or begins it where it is."""
    at_s, name, begun = event
    ended, killed_s, begun_with, next_jobs = about
    robot, own = robots[name], known[begun]
    if robot.cancelled:
        left = known[robot.cancelled]
        if left.priority >= own.priority and _is_open(left, ended, at_s):
            found.turns += 1
            found.turns_back += begun in robot.turned
        robot.turned.add(left.id)
    is_settling = any(0 <= at_s - when_s < DETECTED_S for when_s in killed_s.values())
    living = [each for each in robots if at_s < killed_s.get(each, at_s + 1)]
    # That others have ended something is known a little later.
    free = {
        each
        for each in living
        if each == name or (not robots[each].job and at_s - robots[each].ended_s >= AGREED_S)
    }
    for other in known.values():
        if other.id == begun or not _is_open(other, ended, at_s) or name not in other.able:
            continue
        # Others that begin just now, and what has priority over this, are not free for it.
        busy = {
            each
            for begun_now, those in begun_with.items()
            if not _is_later(known[begun_now], other)
            for each in those
        }
        # A robot without a record may wait for a partner that is on its way to an earlier task.
        waits = any(
            each.count > 1
            and not _is_later(each, other)
            and any(robot.job == each.id for robot in robots.values())
            for each in known.values()
            if each.id != other.id and _is_open(each, ended, at_s)
        )
        free_for = {name} if waits else (free - busy) | {name}
        on_it = {each for each in living if robots[each].job == other.id}
        at_work = {each for each in robots if robots[each].job and not robots[each].is_on_its_way}
        on_it |= begun_with.get(other.id, set()) - at_work
        can_begin = len(on_it | (free_for & other.able)) >= other.count
        if other.count > 1:
            # Robots that wait for their partners at its place have recorded nothing yet.
            idle = {each for each in living if not robots[each].job} - busy
            on_it |= ((free_for | (set() if waits else idle)) & other.able) - {name}
            on_it |= {each for each in idle - {name} if next_jobs.get(each) == other.id}
        if not _is_later(own, other) or len(on_it) >= other.count or not can_begin or is_settling:
            continue
        if own.priority < other.priority:
            found.broken.append(f"{at_s:.2f}: {name} begins {begun} before {other.id}, of priority")
            continue
        # Who sets out again for the same does not overtake again. One more is possible where two
        # robots begin things at once by different plans.
        passed = found.passed.setdefault(other.id, [])
        if any((who, what) == (name, begun) for _, who, what in passed):
            continue
        passed.append((at_s, name, begun))
        found.overtaken[other.id] += 1
        races = any(
            second - first < AGREED_S and one != two
            for (first, _, one), (second, _, two) in pairwise(passed)
        )
        if found.overtaken[other.id] == most_overtaken + races + 1:
            found.broken.append(f"{at_s:.2f}: {other.id} is overtaken once more, by {begun}")


def _is_later(job: Handed, than: Handed) -> bool:
    return (-job.priority, job.at_s) > (-than.priority, than.at_s)


def _is_open(job: Handed, ended: Mapping[str, float], at_s: float) -> bool:
    is_late = job.deadline_s is not None and at_s > job.deadline_s - KNOWN_S
    return job.at_s + KNOWN_S < at_s and job.id not in ended and not is_late


def job_of(activation: str) -> str:
    """`run:node@job:...` -> the job."""
    return activation.split("@", 1)[1].split(":", 1)[0]
