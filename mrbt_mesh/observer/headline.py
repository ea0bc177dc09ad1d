"""How a team is, the worst first: the words that every screen and command shows."""

from __future__ import annotations

import enum
import shlex
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts.records import (
    ADDRESS,
    NETWORK,
    NOT_ASKED,
    PROCESS,
    RECORDING,
    TeamOrder,
    problem_text,
)
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import SECOND_US
from mrbt_mesh.core.mission.mission import Mission, Recorded, performance
from mrbt_mesh.core.mission.names import name_order, type_name
from mrbt_mesh.core.planning.plan import Shortage, Waiting, shortened
from mrbt_mesh.observer.episodes import MajorFault, after_text, lost_text
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.time_at_work import duration_text, overdue

# Robots that `mrbt join` starts.
_STARTABLE = (State.DEAD, State.LEFT)
# Blocked requests, and remedies of each, that are named; the status has all.
MOST_BLOCKED, MOST_REMEDIES = 3, 2
# What a robot reports of how it hears others.
_UNHEARD = (NETWORK, ADDRESS)
# A robot has mostly heard others this soon after its start.
STARTS_WITHIN_US = 5 * SECOND_US


class Level(enum.StrEnum):
    """BAD: the mission does not go on without help. WARN: something is wrong, and it goes on."""

    BAD = "bad"
    WARN = "warn"
    INFO = "info"
    GOOD = "good"


@dataclass(frozen=True, slots=True)
class Statement:
    """One sentence of a headline."""

    level: Level
    text: str

    def to_json(self) -> dict[str, str]:
        """As plain data."""
        return {"level": str(self.level), "text": self.text}


# The result of a run that an operator has ended.
ENDED = "ended"
# How a run has ended; others are bad.
_LEVELS = {"success": Level.GOOD, ENDED: Level.INFO, "not_started": Level.INFO}


def reported_plans(observer: Observer) -> dict[str, bytes]:
    """Robot -> digest of the plan that it last reported, empty for none; sorted.

    Only healthy robots that have joined.
    """
    return {
        robot: peer.report.plan_digest
        for robot, peer in sorted(observer.membership.peers.items())
        if peer.report.has_joined and peer.state.is_healthy
    }


def robots_that_differ(observer: Observer) -> list[str]:
    """The robots that report another plan than most of the others; sorted."""
    digests = reported_plans(observer)
    counts = Counter(digests.values())
    own = observer.plan.digest if observer.plan is not None else b""
    usual = max(counts, key=lambda digest: (counts[digest], digest == own, digest), default=b"")
    return [robot for robot, digest in digests.items() if digest != usual]


def _present(observer: Observer) -> set[str]:
    """The robots that are neither dead nor left; in a recording, membership counts none."""
    return {robot for robot, peer in observer.membership.peers.items() if peer.state.is_member}


def headline(observer: Observer, differing: Collection[str], now_us: int) -> list[Statement]:
    """What is to be said of a team now, the worst first, of one that has ended its result; never
    empty.

    `differing`: the robots that have reported another plan than most for longer than a message
    takes.
    """
    found = [*_alone(observer), *_blocked(observer), *_dead(observer)]
    if observer.ended is not None:
        found += _open_jobs(observer)
    elif observer.record.result is None:
        found += [*_overdue(observer, now_us), *_silent(observer), *_faulty(observer)]
        found += _agreement(observer, differing)
        robots = observer.membership.members()
        texts = (text for each in features() for text in each.warnings(observer.facts, robots))
        found += [*(Statement(Level.WARN, text) for text in texts), *_open_jobs(observer)]
    order = list(Level)
    is_bad = any(statement.level is Level.BAD for statement in found)
    result = list(_result(observer, is_bad))
    if observer.is_over:
        return [*result, *found]
    return sorted([*result, *found], key=lambda statement: order.index(statement.level))


# Jobs that were cancelled and done all the same; others are in the list of jobs.
MAX_OVERRULED = 3


def _open_jobs(observer: Observer) -> Iterator[Statement]:
    jobs = observer.facts.jobs
    count = jobs.count_open() if jobs is not None else 0
    if count:
        yield Statement(Level.INFO, f"{count} job{'' if count == 1 else 's'} open")
    overruled = jobs.overruled() if jobs is not None else []
    for known in overruled[:MAX_OVERRULED]:
        yield Statement(Level.WARN, f"job {known.id}: cancelled; {known.overruled_text}")


def _result(observer: Observer, is_bad: bool) -> Iterator[Statement]:
    record, plan = observer.record, observer.plan
    if record.result is not None:
        level = Level.GOOD if record.result is Status.SUCCESS else Level.BAD
        took_s = record.seconds(record.ended_us)
        after = "" if took_s is None else f" after {took_s:.1f} s"
        yield Statement(level, f"{record.result.name.lower()}{after}")
    elif (end := observer.ended) is not None:
        words = end.because if end.result == ENDED else f"{end.result}: {end.because}"
        text = f"the run is over: {words.removesuffix(': ')}"
        yield Statement(_LEVELS.get(end.result, Level.BAD), text)
    elif record.started_us is None and not observer.running:
        yield Statement(Level.INFO, "waiting for robots")
    elif observer.facts.order() is TeamOrder.PAUSE:
        yield Statement(Level.WARN, "paused: `mrbt resume` goes on")
    elif observer.facts.order() is TeamOrder.ABORT:
        yield Statement(Level.WARN, "aborted: robots stop")
    elif plan is not None and plan.result is not Status.RUNNING:
        yield Statement(Level.INFO, f"{plan.result.name.lower()}, stands by")
    elif plan is not None and not is_bad:
        yield Statement(Level.GOOD, "running")


def _blocked(observer: Observer) -> Iterator[Statement]:
    """The requests that no living robots can serve, each with what would help."""
    plan, record = observer.plan, observer.record
    if observer.is_over:
        return
    if (record.started_us is not None or observer.running) and not _present(observer):
        yield Statement(Level.BAD, "no robot is heard")
    if plan is None:
        return
    reasons = {episode.request for episode in record.blocked if episode.to_us is None}
    waiting = [w for w in plan.waiting if w.is_blocked and w.global_task in reasons]
    for each in waiting[:MOST_BLOCKED]:
        parts = [each.reason.removeprefix("blocked: ")]
        for shortage in each.shortages:
            parts += remedies(observer, shortage)
        parts += _who_would_help(observer, each)
        job = parse_activation(each.activation).job
        name = f"{each.global_task} of job {job}" if job else each.global_task
        yield Statement(Level.BAD, f"BLOCKED: {name}: {': '.join(parts)}")
    if len(waiting) > MOST_BLOCKED:
        yield Statement(Level.BAD, f"BLOCKED: {len(waiting) - MOST_BLOCKED} more tasks")


def remedies(observer: Observer, shortage: Shortage) -> list[str]:
    """What would end a shortage: the robots of the mission that could be started, or mended."""
    task, missing = shortage.local_task, shortage.needed - shortage.alive
    found = []
    for name, robot in observer.mission.robots.items():
        if performance(robot.capabilities, task) is None:
            continue
        known = observer.facts.members.get(name)
        # Its type, if that is lost: it ends the losses of its ground local tasks too.
        lost = [x for x in (type_name(task), task) if known is not None and x in known[0].lost]
        if observer.robot_state(name) in _STARTABLE:
            found.append(_start(name))
        elif known is not None and lost and lost[0] in known[0].watched:
            found.append(f"mend {name} ({known[0].lost[lost[0]]})")
        elif lost:
            found.append(f"mend {name} (`mrbt fault {name} {shlex.quote(lost[0])} --end`)")
    if not found:
        return [f"no other robot of the mission has {task}"]
    return [_joined(found, missing)]


def _who_would_help(observer: Observer, waiting: Waiting) -> list[str]:
    """The robots that could be started, as features say, so that a request can be served."""
    states = {robot: observer.robot_state(robot) for robot in sorted(observer.facts.members)}
    here = [robot for robot, state in states.items() if state.is_member]
    texts = []
    for feature in features():
        robots, missing = feature.would_help(observer.facts, waiting, here)
        found = [_start(r) for r in sorted(robots) if observer.robot_state(r) in _STARTABLE]
        if found:
            texts.append(_joined(found, missing))
    return texts


def _start(robot: str) -> str:
    return f"start {robot} (`mrbt join {robot}`)"


def _joined(texts: Sequence[str], missing: int) -> str:
    """Remedies, of which as many are needed as are missing."""
    joined = " or " if missing < len(texts) else " and "
    return joined.join(texts[:MOST_REMEDIES])


def _dead(observer: Observer) -> Iterator[Statement]:
    """The robots that died and did not come back, with what became of their work. One whose process
    runs is silent, until another robot has declared it dead.
    """
    silent = State.SUSPECT
    faults = sorted(
        (
            fault
            for fault in observer.record.major
            if fault.until_us is None
            and not (fault.detected_us is None and observer.robot_state(fault.robot) is silent)
        ),
        key=lambda fault: name_order(fault.robot),
    )
    if not faults:
        return
    wanted = wanted_activations(observer)
    open_ = [f for f in faults if f.held and f.held.activation in wanted and not f.replacement]
    lost = [fault for fault in open_ if not _now_done_by(observer, fault)]
    text = f"{len(faults)} dead: {shortened([fault.robot for fault in faults])}"
    if len(faults) == 1:
        others = _now_done_by(observer, faults[0]) if open_ else ()
        text += _fate(observer, faults[0], bool(lost), others)
    elif lost:
        text += f", {len(lost)} not replaced yet"
    elif all(fault.replacement or _now_done_by(observer, fault) for fault in faults):
        text += ", all replaced"
    yield Statement(Level.BAD if lost else Level.WARN, text)


def wanted_activations(observer: Observer) -> set[str]:
    """What the tree requests now; a dead robot's work is wanted while it is among these."""
    if observer.is_over or observer.plan is None:
        return set()
    return {request.activation for request in observer.plan.evaluation.requests}


def _now_done_by(observer: Observer, fault: MajorFault) -> tuple[str, ...]:
    """The living robots that work on what a dead one did, if they are as many as it takes; so it
    is where nobody has seen them begin, too.
    """
    held, plan = fault.held, observer.plan
    if held is None or plan is None:
        return ()
    for each in plan.bounds:
        if (each.activation, each.local_task) == (held.activation, held.local_task):
            wanted = each.activation, each.local_task
            claims = [(robot, observer.claim(robot)) for robot in each.robots]
            at_work = [r for r, c in claims if c and (c.activation, c.local_task) == wanted]
            return tuple(at_work) if len(at_work) >= max(1, each.lower) else ()
    return ()


def _fate(observer: Observer, fault: MajorFault, is_wanted: bool, others: Sequence[str]) -> str:
    """What became of a dead robot's work; `others` do it now, as is seen by their claims alone."""
    if fault.held is None:
        return ", was idle"
    if others:
        verb = "has" if len(others) == 1 else "have"
        return f", {shortened(others)} {verb} {fault.held.local_task}"
    if fault.reassigned_after_us is None:
        if is_wanted:
            return f", {fault.held.local_task} is not replaced yet"
        done = observer.facts.results(fault.held.activation, fault.held.local_task)
        by = sorted((r for r, is_good in done.items() if is_good), key=name_order)
        by = [robot for robot in by if robot != fault.robot]
        # Who comes late may know no more than that nobody asks for it.
        how = f"was done by {shortened(by)}" if by else "is over, or no longer needed"
        return f", {fault.held.local_task} {how}"
    if fault.is_older:
        # Whether that robot began it before or after the death is not known.
        return f", {fault.replacement} has {fault.held.local_task}"
    after = after_text(fault.reassigned_after_us, fault.exact)
    return f", replaced by {fault.replacement} after {after}"


def _silent(observer: Observer) -> Iterator[Statement]:
    states = {robot: observer.robot_state(robot) for robot in observer.robots()}
    silent = [robot for robot, state in states.items() if state is State.SUSPECT]
    silent.sort(key=name_order)
    if silent:
        yield Statement(Level.WARN, f"{len(silent)} silent: {shortened(silent)}")


def _overdue(observer: Observer, now_us: int) -> Iterator[Statement]:
    """The robots whose work takes far longer than the mission says: one of them, and how many."""
    late = list(overdue(observer, now_us))
    for each in late[:1]:
        for_s, expected_s = duration_text(each.for_s), duration_text(each.expected_s or 0)
        text = f"{each.robot} has worked on {each.local_task} for {for_s}, {expected_s} is expected"
        if len(late) > 1:
            more = "1 more robot is" if len(late) == 2 else f"{len(late) - 1} more robots are"
            text += f"; {more} as late"
        yield Statement(Level.WARN, text)


def _alone(observer: Observer) -> Iterator[Statement]:
    """Robots that have never heard another one: what others do they may do as well."""
    heartbeat_us = observer.membership.timing.heartbeat_us
    for robot, peer in sorted(observer.membership.peers.items()):
        is_late = peer.report.number * heartbeat_us > STARTS_WITHIN_US
        waits = is_late and peer.state.is_member and not peer.report.has_joined
        if waits and peer.heartbeat is not None and not peer.heartbeat.relays:
            text = f"{robot} waits: it has heard no other robot (--alone begins at once)"
            yield Statement(Level.WARN, text)
    for (robot, subject), episode in observer.record.problems.items():
        if subject in _UNHEARD and episode.to_us is None and robot in _present(observer):
            yield Statement(Level.WARN, f"{robot}: {problem_text(subject, episode.problem)}")


def _faulty(observer: Observer) -> Iterator[Statement]:
    """Lost capabilities, and what is wrong with programs and journals."""
    record, members = observer.record, _present(observer)
    for fault in record.minor:
        if fault.until_us is None and fault.robot in members:
            text = f"{fault.robot} {lost_text(fault.local_tasks, fault.reason)}"
            yield Statement(Level.WARN, text)
    unrecorded: dict[str, list[str]] = {}
    for (robot, subject), episode in record.problems.items():
        if episode.to_us is not None or (robot not in members and subject != PROCESS):
            continue
        if subject in _UNHEARD:
            continue
        if subject == RECORDING:
            unrecorded.setdefault(episode.problem, []).append(robot)
            continue
        text = f"{robot}: {problem_text(subject, episode.problem)}"
        yield Statement(Level.WARN, text)
    yield from _unrecorded(unrecorded, observer.mission)


def _unrecorded(robots: Mapping[str, Sequence[str]], mission: Mission) -> Iterator[Statement]:
    """Robots by why they do not record; the worst first."""
    is_required = mission.recorded is Recorded.REQUIRED
    follows = ", so it takes no exclusive task" if is_required else ""
    for problem in sorted(robots, key=lambda each: (each == NOT_ASKED, each)):
        is_wanted = is_required or problem != NOT_ASKED
        level = Level.WARN if is_wanted else Level.INFO
        names = shortened(sorted(robots[problem], key=name_order))
        yield Statement(level, f"{names}: {problem}{follows}")


def _agreement(observer: Observer, differing: Collection[str]) -> Iterator[Statement]:
    robots = len(reported_plans(observer))
    if differing:
        names = shortened(sorted(differing, key=name_order))
        yield Statement(Level.WARN, f"{len(differing)} with another plan: {names}")
    elif robots:
        agreed = "agreeing" if robots_that_differ(observer) else f"all {robots} agree"
        yield Statement(Level.GOOD, "one robot" if robots == 1 else agreed)
