"""Judges a drill's expectations by the robots' recordings and journals, and by the faults.

"It did not happen" holds only if it would have been recorded.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.drills.beside import Check
from mrbt_mesh.drills.inject import InjectedFaults
from mrbt_mesh.drills.journals import Done
from mrbt_mesh.drills.links import LinkLine, silent_at_the_end, slow_returns
from mrbt_mesh.drills.model import DoneModel, ExpectModel, NeverModel, Robots
from mrbt_mesh.drills.physical import YIELDS_WITHIN_S, Span, most_at_once, moving, spans
from mrbt_mesh.drills.triggers import Snapshot, chosen

LIVING = (State.ALIVE, State.SUSPECT)


@dataclass(frozen=True)
class DrillResult:
    """One expectation: whether it held, and what was found."""

    expected: str
    holds: bool
    found: str


@dataclass
class Evidence:
    """What is known about a run, for the judge.

    `journals` are as at the end. `is_obsolete` tells if no evaluation can reach an activation any
    more by then. `takeovers` are as in summary.json, plus `inflicted` (the drill caused it) and
    `ended` (the robot's process had really ended). `beside_ended`: processes that should have run
    until the end, but ended. `checks`: the results of the drill's check commands. `events`: starts
    and ends of local tasks, as read by `recorded_work`. `unrecorded`: robots that did not record
    everything they did. `logs`: how many robots have written a log.
    """

    result: str
    injected: InjectedFaults = field(default_factory=InjectedFaults)
    ended_because: str | None = None
    steps_left: list[str] = field(default_factory=list)
    crashes: list[str] = field(default_factory=list)
    states: Mapping[str, State] = field(default_factory=dict)
    takeovers: list[dict[str, Any]] = field(default_factory=list)
    blocked: frozenset[str] = frozenset()
    events: list[dict[str, Any]] = field(default_factory=list)
    unrecorded: set[str] = field(default_factory=set)
    logs: int = 0
    journals: Mapping[str, frozenset[Done]] = field(default_factory=dict)
    is_obsolete: Callable[[str], bool] = lambda activation: False
    links: list[LinkLine] = field(default_factory=list)
    beside_ended: list[str] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)


def judge(expect: ExpectModel, mission: Mission, evidence: Evidence) -> list[DrillResult]:
    """Return a result for each expectation, in the order of the file's keys."""
    return list(_Judge(expect, mission, evidence).results())


def _at_most(expected: str, found: Sequence[str], most: int, unobserved: str) -> DrillResult:
    """Return whether at most `most` were found; `unobserved` says why nothing could be found."""
    holds = len(found) <= most and not unobserved
    return DrillResult(expected, holds, ", ".join(found) or unobserved or "none")


class _Judge:
    def __init__(self, expect: ExpectModel, mission: Mission, evidence: Evidence) -> None:
        self.expect = expect
        self.mission = mission
        self.evidence = evidence
        self.injected = evidence.injected
        self.spans = spans(evidence.events, self.injected.deaths)

    def results(self) -> Iterator[DrillResult]:
        expect, evidence = self.expect, self.evidence
        because = f" ({evidence.ended_because})" if evidence.ended_because is not None else ""
        is_expected = evidence.result == expect.result
        yield DrillResult(f"result {expect.result}", is_expected, evidence.result + because)
        wrong = [f"{step}: its moment never came" for step in evidence.steps_left]
        wrong += self.injected.problems
        yield DrillResult("all faults carried out", not wrong, "; ".join(wrong) or "yes")
        crashes = "; ".join(evidence.crashes) or "none"
        yield DrillResult("no robot ended by an error", not evidence.crashes, crashes)
        for done in expect.done:
            yield from self.done(done)
        for never in expect.never:
            yield from self.never(never)
        yield from self.states("dead", expect.dead, (State.DEAD,))
        yield from self.states("alive", expect.alive, LIVING)
        yield from self.states("left", expect.left, (State.LEFT,))
        for robot in self.robots(expect.yields) if expect.yields is not None else ():
            yield self.yields(robot)
        blocked = ", ".join(sorted(evidence.blocked)) or "nothing"
        for task in expect.was_blocked:
            is_blocked = task in evidence.blocked
            yield DrillResult(f"{task} was blocked", is_blocked, f"blocked: {blocked}")
        limits: tuple[tuple[Any, Callable[[Any], DrillResult]], ...] = (
            (expect.detected_within_s, self.detected),
            (expect.takeover_within_s, self.taken_over),
            (expect.repeated, self.repeated),
            (expect.repeated, self.lost),
            (expect.false_deaths, self.false_deaths),
            (expect.links_back_within_s, self.links_back),
            (expect.stalls, self.stalls),
        )
        for limit, judged in limits:
            if limit is not None:
                yield judged(limit)
        for ended in evidence.beside_ended:
            yield DrillResult("beside the team until its end", False, ended)
        for check in evidence.checks:
            yield DrillResult(check.command, check.status == 0, check.said)

    def robots(self, robots: Robots) -> list[str]:
        """Return the robots meant, with the roles that they had at the end."""
        return chosen(robots, Snapshot(0), self.injected.fault_log)

    def states(
        self, word: str, meant: Robots | None, good: Collection[State]
    ) -> Iterator[DrillResult]:
        if meant is None:
            return
        states = {robot: self.evidence.states.get(robot) for robot in self.robots(meant)}
        text = ", ".join(f"{robot} {state or 'unknown'}" for robot, state in states.items())
        holds = bool(states) and all(state in good for state in states.values())
        yield DrillResult(f"{word} at the end: {' '.join(states)}", holds, text or "no such robot")

    # -- what was done in the world ---------------------------------------------------------

    def grounds(self, task: str) -> list[str]:
        """Return the ground local tasks of a name that were ever started.

        A ground task is itself.
        """
        started = sorted({s.ground for s in self.spans if task in (s.ground, type_name(s.ground))})
        return started or [task]

    def done(self, done: DoneModel) -> Iterator[DrillResult]:
        least, most = done.bounds
        bounds = f"{least}" if least == most else f"{least} to {'any' if most is None else most}"
        where = f" for {done.global_task}" if done.global_task else ""
        for ground in self.grounds(done.local_task):
            robots = [
                span.robot
                for span in self.spans
                if span.ground == ground
                and span.end == "success"
                and done.global_task in (None, span.global_task)
            ]
            holds = least <= len(robots) and (most is None or len(robots) <= most)
            text = f"{len(robots)} ({', '.join(robots)})" if robots else "0"
            yield DrillResult(f"{ground}{where} done {bounds}×", holds, text)

    def never(self, never: NeverModel) -> Iterator[DrillResult]:
        for ground in self.grounds(never.local_task):
            works = [span for span in self.spans if span.ground == ground]
            most = most_at_once(
                replace(part, end_s=part.end_s - never.overlap_s)
                for span in works
                for part in moving(span, self.injected.freezes)
            )
            expected = f"never more than {never.more_than} at {ground}"
            unobserved = self.unobserved(works, ground)
            is_within = most <= never.more_than
            text = unobserved if is_within and unobserved else f"at most {most}"
            yield DrillResult(expected, is_within and not unobserved, text)

    def unobserved(self, works: Sequence[Span], what: str) -> str:
        """Return why it is not known what was done; empty if it is known."""
        if not works:
            return f"nothing was recorded for {what}"
        robots = ", ".join(sorted(self.evidence.unrecorded))
        return f"not all was recorded by {robots}" if robots else ""

    def yields(self, robot: str) -> DrillResult:
        """Judge that a robot, when it wakes, cancels the work during which it was frozen."""
        frozen = [
            (span, span.end == "cancel" and span.end_s <= freeze.to_s + YIELDS_WITHIN_S)
            for freeze in self.injected.freezes
            for span in self.spans
            if span.pid == freeze.pid
            and span.robot == robot
            and span.start_s < freeze.from_s < span.end_s
        ]
        ends = {True: "cancel", False: "went on"}
        text = ", ".join(
            f"{span.ground}: {ends[gave_up] if span.end == 'cancel' else span.end or 'no end'}"
            for span, gave_up in frozen
        )
        text = text or "it did nothing"
        holds = bool(frozen) and all(gave_up for _, gave_up in frozen)
        return DrillResult(f"{robot} yields when it wakes", holds, text)

    # -- faults and what followed -------------------------------------------------------------

    def detected(self, limit_s: float) -> DrillResult:
        return self.within("detected", "detected_s", limit_s)

    def taken_over(self, limit_s: float) -> DrillResult:
        return self.within("taken over", "reassigned_s", limit_s)

    def within(self, word: str, key: str, limit_s: float) -> DrillResult:
        times = {
            f"{each['robot']} at {each['at_s']:.2f} s": each[key]
            for each in self.evidence.takeovers
            if each["inflicted"] and (each["held"] or key != "reassigned_s")
        }
        holds = bool(times) and all(t is not None and t <= limit_s for t in times.values())
        text = ", ".join(
            f"{fault}: {'never' if t is None else f'{t * 1e3:.0f} ms'}"
            for fault, t in times.items()
        )
        return DrillResult(f"{word} within {limit_s:g} s", holds, text or "no fault was noticed")

    def false_deaths(self, most: int) -> DrillResult:
        # At the end of a mission, robots that finish first end before the rest.
        found = [
            f"{each['robot']} at {each['at_s']:.2f} s"
            for each in self.evidence.takeovers
            if not each["inflicted"] and not each["ended"]
        ]
        expected = f"at most {most} robots falsely held dead" if most else "no false death"
        is_seen = self.evidence.states or self.evidence.takeovers
        unobserved = "" if is_seen else "no robot was seen"
        return _at_most(expected, found, most, unobserved)

    # -- links ----------------------------------------------------------------------------------

    def links_back(self, limit_s: float) -> DrillResult:
        """Judge that links came back. Links of robots whose processes were stopped are ignored."""
        hit = self.injected.hit()
        lines = [line for line in self.evidence.links if not line.pair & hit]
        heals_s = [each.unix_s for each in self.injected.done if each.fault in ("heal", "unblock")]
        wrong = [f"{line.robot} hears {line.peer} no more" for line in silent_at_the_end(lines)]
        wrong += [
            f"{line.robot} heard {line.peer} after {took_s:.1f} s"
            for line, took_s in slow_returns(lines, heals_s, limit_s)
        ]
        back = sum(line.back for line in lines)
        text = "; ".join(wrong) or (f"{back} links came back" if back else "no link was lost")
        expected = f"links heard again within {limit_s:g} s"
        return DrillResult(expected, bool(back) and not wrong, text)

    def stalls(self, most: int) -> DrillResult:
        hit = self.injected.hit()
        found = [
            f"{line.robot} did not hear {line.peer}"
            for line in self.evidence.links
            if line.event == "link_silent"
            and not line.pair & hit
            and line.pair not in self.injected.disturbed
        ]
        expected = f"at most {most} healthy links stall" if most else "no healthy link stalls"
        is_logged = self.evidence.logs or self.evidence.links
        return _at_most(expected, found, most, "" if is_logged else "no robot has a log")

    # -- journals -----------------------------------------------------------------------------

    def repeated(self, most: int) -> DrillResult:
        found = repeats(self.mission, self.spans, self.injected)
        expected = f"at most {most} journaled local tasks repeated" if most else "nothing repeated"
        texts = [f"{span.ground} by {span.robot}" for span in found]
        unobserved = self.unobserved(self.spans, "any local task")
        return _at_most(expected, texts, most, unobserved)

    def lost(self, _: int) -> DrillResult:
        found = [
            f"{done.local_task} by {done.robot}"
            for done in losses(self.injected, self.evidence.journals)
            if not self.evidence.is_obsolete(done.activation)
        ]
        unobserved = "" if self.evidence.journals else "no journal was read"
        return _at_most("nothing journaled is lost", found, 0, unobserved)


def repeats(mission: Mission, found: Iterable[Span], injected: InjectedFaults) -> list[Span]:
    """Return executions that began although journals of robots killed before held their end.

    The end is as many successes as the local task needs, of one coalition if it needs several, or a
    success of the same robot.
    """
    # (global task, local task) -> the number of successes that end that local task.
    least = {
        (task.id, need.local_task): need.min_robots
        for task in mission.global_tasks.values()
        for need in task.needs
    }
    result = []
    for span in found:
        known = {
            done
            for at_death in injected.journals_at_death
            if at_death.unix_s < span.start_s
            for held in at_death.journals.values()
            for done in held
            if (done.activation, done.local_task) == (span.activation, span.ground)
        }
        own = any(done.robot == span.robot and not done.coalition for done in known)
        together = Counter(done.coalition for done in known)
        # If help is optional, a helper is never one too many.
        needed = least.get((span.global_task, span.ground), 1)
        enough = 0 < needed <= max(together.values(), default=0)
        if own or enough:
            result.append(span)
    return result


def losses(injected: InjectedFaults, journals: Mapping[str, frozenset[Done]]) -> list[Done]:
    """Return successes that a robot's journal held when it was killed and that no journal holds
    now.

    Callers exclude obsolete activations, whose successes are forgotten on purpose.
    """
    kept = frozenset(done for held in journals.values() for done in held)
    then = {
        done for s in injected.journals_at_death for held in s.journals.values() for done in held
    }
    return sorted(then - kept)


def unjournaled(found: Iterable[Span], injected: InjectedFaults) -> list[Span]:
    """Return successes in the world that a kill kept out of their robot's journal.

    The action had recorded its end, and the process died before its outcome was committed.
    """
    result = []
    listed = list(found)
    for at_death in injected.journals_at_death:
        for robot, held in at_death.journals.items():
            ends = [s for s in listed if s.robot == robot and s.end == "success"]
            ends = [s for s in ends if s.end_s <= at_death.unix_s]
            known = {(done.robot, done.activation, done.local_task) for done in held}
            result += [s for s in ends if (robot, s.activation, s.ground) not in known]
    # One that is missing at a first kill is also missing at the next.
    return list(Counter(result))
