"""What held and what did not: from events.jsonl, the journals, and what was done to the team."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.names import type_name
from mrbt_mesh.drills.beside import Check
from mrbt_mesh.drills.inject import InjectedFaults
from mrbt_mesh.drills.journals import Done
from mrbt_mesh.drills.links import LinkLine, silent_at_the_end, slow_returns
from mrbt_mesh.drills.model import DoneModel, ExpectModel, NeverModel, Robots
from mrbt_mesh.drills.physical import Span, most_at_once, moving, spans
from mrbt_mesh.drills.triggers import Snapshot, chosen

LIVING = (State.ALIVE, State.SUSPECT)


@dataclass(frozen=True)
class DrillVerdict:
    """One expectation: whether it held, and what was found."""

    expected: str
    holds: bool
    found: str


@dataclass
class Evidence:
    """What is known of a run. `journals` as at the end, when `is_obsolete` says of an activation
    that no evaluation can reach it any more.

    `takeovers` as in summary.json, with `inflicted`: whether the drill did that to the robot,
    and `ended`: whether its process had really ended. `beside_ended`: what should have run until
    the end. `checks`: what the commands to be asked said.
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
    journals: Mapping[str, frozenset[Done]] = field(default_factory=dict)
    is_obsolete: Callable[[str], bool] = lambda activation: False
    links: list[LinkLine] = field(default_factory=list)
    beside_ended: list[str] = field(default_factory=list)
    checks: list[Check] = field(default_factory=list)


def judge(expect: ExpectModel, mission: Mission, evidence: Evidence) -> list[DrillVerdict]:
    """A verdict for each expectation, in the order of the file's keys."""
    return _Judge(expect, mission, evidence).verdicts()


class _Judge:
    def __init__(self, expect: ExpectModel, mission: Mission, evidence: Evidence) -> None:
        self.expect = expect
        self.mission = mission
        self.evidence = evidence
        self.injected = evidence.injected
        self.spans = spans(evidence.events, self.injected.deaths)

    def verdicts(self) -> list[DrillVerdict]:
        expect = self.expect
        found = [self.result(), self.steps(), self.crashes()]
        found += [verdict for done in expect.done for verdict in self.done(done)]
        found += [verdict for never in expect.never for verdict in self.never(never)]
        for word, robots, states in (
            ("dead", expect.dead, (State.DEAD,)),
            ("alive", expect.alive, LIVING),
            ("left", expect.left, (State.LEFT,)),
        ):
            if robots is not None:
                found.append(self.states(word, robots, states))
        if expect.yields is not None:
            found += [self.yields(robot) for robot in self.robots(expect.yields)]
        found += [
            DrillVerdict(
                f"{task} was blocked", task in self.evidence.blocked, self.listed_blocked()
            )
            for task in expect.was_blocked
        ]
        if expect.detected_within_s is not None:
            found.append(self.within("detected", "detected_s", expect.detected_within_s))
        if expect.takeover_within_s is not None:
            found.append(self.within("taken over", "reassigned_s", expect.takeover_within_s))
        if expect.repeated is not None:
            found += [self.repeated(expect.repeated), self.lost()]
        if expect.false_deaths is not None:
            found.append(self.false_deaths(expect.false_deaths))
        if expect.links_back_within_s is not None:
            found.append(self.links_back(expect.links_back_within_s))
        if expect.stalls is not None:
            found.append(self.stalls(expect.stalls))
        found += [
            DrillVerdict("beside the team until its end", False, ended)
            for ended in self.evidence.beside_ended
        ]
        found += [
            DrillVerdict(check.command, check.status == 0, check.said)
            for check in self.evidence.checks
        ]
        return found

    # -- the run --------------------------------------------------------------------------

    def result(self) -> DrillVerdict:
        evidence = self.evidence
        text = evidence.result
        if evidence.ended_because is not None:
            text += f" ({evidence.ended_because})"
        return DrillVerdict(
            f"result {self.expect.result}", evidence.result == self.expect.result, text
        )

    def steps(self) -> DrillVerdict:
        wrong = [f"{step}: its moment never came" for step in self.evidence.steps_left]
        wrong += self.injected.problems
        return DrillVerdict("all faults carried out", not wrong, "; ".join(wrong) or "yes")

    def crashes(self) -> DrillVerdict:
        crashes = self.evidence.crashes
        return DrillVerdict("no robot ended by an error", not crashes, "; ".join(crashes) or "none")

    def states(self, word: str, robots: Robots, good: Iterable[State]) -> DrillVerdict:
        listed = self.robots(robots)
        states = {robot: self.evidence.states.get(robot) for robot in listed}
        text = ", ".join(f"{robot} {state or 'unknown'}" for robot, state in states.items())
        holds = bool(listed) and all(state in tuple(good) for state in states.values())
        return DrillVerdict(
            f"{word} at the end: {' '.join(listed)}", holds, text or "no such robot"
        )

    def robots(self, robots: Robots) -> list[str]:
        """The robots that are meant, with the roles that they had at the end."""
        return chosen(robots, Snapshot(0), self.injected.fault_log)

    def listed_blocked(self) -> str:
        return "blocked: " + (", ".join(sorted(self.evidence.blocked)) or "nothing")

    # -- what was done in the world ---------------------------------------------------------

    def grounds(self, task: str) -> list[str]:
        """The ground local tasks of a name that were ever started; a ground one is itself."""
        started = sorted({s.ground for s in self.spans if task in (s.ground, type_name(s.ground))})
        return started or [task]

    def done(self, done: DoneModel) -> list[DrillVerdict]:
        least, most = done.bounds
        bounds = f"{least}" if least == most else f"{least} to {'any' if most is None else most}"
        verdicts = []
        for ground in self.grounds(done.local_task):
            ends = [
                span
                for span in self.spans
                if span.ground == ground
                and span.end == "success"
                and done.global_task in (None, span.global_task)
            ]
            holds = least <= len(ends) and (most is None or len(ends) <= most)
            where = f" for {done.global_task}" if done.global_task else ""
            by = ", ".join(span.robot for span in ends)
            text = f"{len(ends)}" + (f" ({by})" if by else "")
            verdicts.append(DrillVerdict(f"{ground}{where} done {bounds}×", holds, text))
        return verdicts

    def never(self, never: NeverModel) -> list[DrillVerdict]:
        verdicts = []
        for ground in self.grounds(never.local_task):
            parts = [
                part
                for span in self.spans
                if span.ground == ground
                for part in moving(span, self.injected.freezes)
            ]
            most = most_at_once(parts)
            verdicts.append(
                DrillVerdict(
                    f"never more than {never.more_than} at {ground}",
                    most <= never.more_than,
                    f"at most {most}",
                )
            )
        return verdicts

    def yields(self, robot: str) -> DrillVerdict:
        """What a robot was doing when it was frozen, it must cancel when it wakes."""
        frozen = [
            span
            for freeze in self.injected.freezes
            for span in self.spans
            if span.pid == freeze.pid
            and span.robot == robot
            and span.start_s < freeze.from_s < span.end_s
        ]
        text = ", ".join(f"{s.ground}: {s.end or 'no end'}" for s in frozen) or "it did nothing"
        holds = bool(frozen) and all(span.end == "cancel" for span in frozen)
        return DrillVerdict(f"{robot} yields when it wakes", holds, text)

    # -- faults and what followed -------------------------------------------------------------

    def within(self, word: str, key: str, limit_s: float) -> DrillVerdict:
        answers = [takeover for takeover in self.evidence.takeovers if takeover["inflicted"]]
        if key == "reassigned_s":
            answers = [takeover for takeover in answers if takeover["held"]]
        times = {f"{t['robot']} at {t['at_s']:.2f} s": t[key] for t in answers}
        holds = bool(times) and all(t is not None and t <= limit_s for t in times.values())
        text = ", ".join(
            f"{who}: {'never' if t is None else f'{t * 1e3:.0f} ms'}" for who, t in times.items()
        )
        return DrillVerdict(f"{word} within {limit_s:g} s", holds, text or "no fault was noticed")

    def false_deaths(self, most: int) -> DrillVerdict:
        # At the end of a mission those who are done first are gone before the others are.
        false = [t for t in self.evidence.takeovers if not t["inflicted"] and not t["ended"]]
        text = ", ".join(f"{t['robot']} at {t['at_s']:.2f} s" for t in false)
        expected = f"at most {most} robots falsely held dead" if most else "no false death"
        return DrillVerdict(expected, len(false) <= most, text or "none")

    # -- links ----------------------------------------------------------------------------------

    def links_back(self, limit_s: float) -> DrillVerdict:
        """Links of robots whose processes were stopped are left out."""
        hit = self.injected.hit()
        lines = [line for line in self.evidence.links if not line.pair & hit]
        heals_s = [
            fault.unix_s for fault in self.injected.done if fault.fault in ("heal", "unblock")
        ]
        wrong = [f"{line.robot} hears {line.peer} no more" for line in silent_at_the_end(lines)]
        wrong += [
            f"{line.robot} heard {line.peer} after {took_s:.1f} s"
            for line, took_s in slow_returns(lines, heals_s, limit_s)
        ]
        back = sum(line.back for line in lines)
        text = "; ".join(wrong) or (f"{back} links came back" if back else "no link was lost")
        return DrillVerdict(
            f"links heard again within {limit_s:g} s", bool(back) and not wrong, text
        )

    def stalls(self, most: int) -> DrillVerdict:
        hit = self.injected.hit()
        found = [
            f"{line.robot} did not hear {line.peer}"
            for line in self.evidence.links
            if not line.back and not line.pair & hit and line.pair not in self.injected.disturbed
        ]
        expected = f"at most {most} healthy links stall" if most else "no healthy link stalls"
        return DrillVerdict(expected, len(found) <= most, "; ".join(found) or "none")

    # -- journals -----------------------------------------------------------------------------

    def repeated(self, most: int) -> DrillVerdict:
        found = repeats(self.mission, self.spans, self.injected)
        text = ", ".join(f"{span.ground} by {span.robot}" for span in found)
        expected = f"at most {most} journaled local tasks repeated" if most else "nothing repeated"
        return DrillVerdict(expected, len(found) <= most, text or "none")

    def lost(self) -> DrillVerdict:
        gone = losses(self.injected, self.evidence.journals)
        found = [done for done in gone if not self.evidence.is_obsolete(done.activation)]
        text = ", ".join(f"{done.local_task} by {done.robot}" for done in found)
        return DrillVerdict("nothing journaled is lost", not found, text or "none")


def needed(mission: Mission) -> Callable[[str, str], int]:
    """(global task, local task) -> how many successes end that local task (nu)."""
    bounds = {
        (task.id, need.local_task): need.min_robots
        for task in mission.global_tasks.values()
        for need in task.needs
    }
    return lambda global_task, local_task: bounds.get((global_task, local_task), 1)


def repeats(mission: Mission, found: Iterable[Span], injected: InjectedFaults) -> list[Span]:
    """Executions that began although journals of robots killed before held their end.

    That is: as many successes as the local task needs, of one coalition where it asks for that,
    or else a success of the same robot.
    """
    least = needed(mission)
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
        # Where nobody has to help, nobody who does is one too many.
        enough = 0 < least(span.global_task, span.ground) <= max(together.values(), default=0)
        if own or enough:
            result.append(span)
    return result


def losses(injected: InjectedFaults, journals: Mapping[str, frozenset[Done]]) -> list[Done]:
    """Successes that a robot's journal held when it was killed and no journal holds now.

    Those of obsolete activations are forgotten on purpose.
    """
    kept = frozenset(done for held in journals.values() for done in held)
    then = {
        done for s in injected.journals_at_death for held in s.journals.values() for done in held
    }
    return sorted(then - kept)


def unjournaled(found: Iterable[Span], injected: InjectedFaults) -> list[Span]:
    """Successes in the world that a kill kept out of their robot's journal.

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
    # One that is missing at a first kill is missing at the next as well.
    return list(Counter(result))
