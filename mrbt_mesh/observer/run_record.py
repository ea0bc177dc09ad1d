"""The record of one run: its events with their times. `summary` makes the report of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.tree import Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import (
    Claim,
    ConditionValue,
    Member,
    NoClaim,
    Outcome,
    Phase,
    RobotProblem,
    problem_text,
)
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import changed_performances
from mrbt_mesh.core.facts.values import texts_by_reason
from mrbt_mesh.core.feature import features
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.conditions import Value
from mrbt_mesh.core.mission.jobs import place_at
from mrbt_mesh.core.mission.mission import MICRO, Mission
from mrbt_mesh.core.planning.plan import Plan
from mrbt_mesh.observer.episodes import (
    BlockedEpisode,
    DeathTimes,
    FailedEnd,
    MajorFault,
    MinorFault,
    ProblemEpisode,
    lost_text,
)
from mrbt_mesh.observer.feature_history import FeatureHistory
from mrbt_mesh.observer.job_log import JobLog
from mrbt_mesh.observer.mission_rounds import MissionRounds
from mrbt_mesh.observer.newest import Newest
from mrbt_mesh.observer.task_log import TaskLog
from mrbt_mesh.observer.work_log import WorkLog

# Of jobs there may be thousands, which have lists of their own.
_OF_JOBS = {records.JOB, records.JOB_HOLD, records.JOB_PRIORITY, records.JOB_CANCELLED}
_HIDDEN_COMMANDS = _OF_JOBS.union(
    *([f for f, known in each.commands.items() if not known.is_shown] for each in features())
)
_SHOWN_COMMANDS = records.COMMANDS - _HIDDEN_COMMANDS
# How many activations are kept of a robot whose own heartbeat has not come yet.
MAX_EARLY = 64


class RunRecord:
    """Collects the run. Times are on the observer's clock, reported from `started_us` on.

    `claims` and `conditions`: in order and with their times. `problems`: by robot, and its journal
    or a part of its program. `features`: what they keep. `joined_us`: when each robot joined first.
    `rounds`: those of a mission that never ends. `unwatched`: the times during which nothing was
    heard of the run; None: from its start, whenever that was. `is_catching_up`: news may be as old
    as that.

    `limit`: how many entries are kept of each list that grows with the work done (`Newest`); faults
    and blocked requests are all kept.
    """

    def __init__(
        self,
        mission: Mission,
        limit: int | None = None,
        clock_ahead_us: Callable[[], int | None] = lambda: None,
    ) -> None:
        self.mission = mission
        self.started_us: int | None = None
        self.ended_us: int | None = None
        self.result: Status | None = None
        self.robots: dict[str, dict[str, Any]] = {}
        self.task_log = TaskLog(mission, limit)
        self.work_log = WorkLog(limit)
        self.job_log = JobLog(mission, clock_ahead_us)
        self.rounds = MissionRounds(limit)
        self.major: list[MajorFault] = []
        self.minor: list[MinorFault] = []
        self.blocked: list[BlockedEpisode] = []
        self.failures = Newest[FailedEnd](limit)
        self.timeline = Newest[tuple[int, str]](limit)
        self.claims = Newest[tuple[int, str, Claim]](limit)
        self.conditions = Newest[tuple[int, str, Value | None]](limit)
        self.problems: dict[tuple[str, str], ProblemEpisode] = {}
        self.joined_us: dict[str, int] = {}
        self.features: list[FeatureHistory] = []
        self._feature_of: dict[str, FeatureHistory] = {}
        for feature in features():
            if (history := feature.history(limit)) is not None:
                self.features.append(history)
                self._feature_of |= dict.fromkeys(feature.kinds, history)
        self._claims: dict[str, tuple[Claim, Incarnation]] = {}
        # Robot -> the newest activations that it has begun, with its life; while that is not known.
        self._early: dict[str, deque[tuple[str, Incarnation]]] = {}
        self.unwatched: list[tuple[int | None, int]] = []
        self.is_catching_up = False
        self._exits: dict[str, int] = {}
        # Robots that revisions have removed: they leave, and do not die.
        self._removed: set[str] = set()
        # Of those deaths that another observer has recorded: its times count, not those seen here.
        self._known_times: dict[tuple[str, Incarnation], DeathTimes] = {}
        self._declared: set[tuple[str, Incarnation]] = set()
        # Robots of which nothing was heard since the run was watched again.
        self._unheard: set[str] = set()

    def say(self, now_us: int, text: str) -> None:
        """Add a line to the timeline."""
        self.timeline.append((now_us, text))

    def _say_heard(self, now_us: int, text: str) -> None:
        """Add a line, if there is one, about an event that may be older than this watch."""
        if text:
            self.say(now_us, f"{text} (earlier)" if self.is_catching_up else text)

    # -- when it is watched ---------------------------------------------------------------

    def use(self, mission: Mission) -> None:
        """Tell the run by this mission, the one with which it begins."""
        self.mission = mission
        self.task_log.revised(mission)
        self.job_log.revised(mission)

    def revised(self, mission: Mission, now_us: int) -> None:
        """Another revision of the mission is in force. Robots that it removes leave; of those that
        were dead the fault is over.
        """
        removed = sorted(self.mission.robots.keys() - mission.robots.keys())
        self._removed = (self._removed - mission.robots.keys()).union(removed)
        for fault in self.major:
            if fault.robot in removed and fault.until_us is None:
                self._is_back(fault, now_us)
                self.robots[fault.robot]["state"] = State.LEFT
        self.use(mission)
        self.say(now_us, f"revision {mission.number} of the mission is in force")

    def watched_from(self, now_us: int, until_us: int | None) -> None:
        """The run is watched (again) from now on; the record so far ends at `until_us`."""
        self.unwatched.append((until_us, now_us))
        self.is_catching_up = True
        self._unheard = {robot for robot, known in self.robots.items() if "incarnation" in known}

    def missed(self, now_us: int) -> None:
        """Robots that have not been heard until now are dead."""
        until_us = self.unwatched[-1][0] if self.unwatched else None
        for robot in sorted(self._unheard):
            if self.robots[robot].get("state") not in (State.DEAD, State.LEFT):
                self.state(robot, State.DEAD, now_us if until_us is None else until_us, now_us)
                fault = self.major[-1]
                fault.is_older = (robot, fault.incarnation) not in self._known_times
        self._unheard = set()

    # -- observations ---------------------------------------------------------------------

    def robot_seen(self, robot: str, incarnation: Incarnation, now_us: int) -> None:
        """A heartbeat of a robot that has joined."""
        known = self.robots.setdefault(robot, {})
        if robot in self._unheard:
            self._unheard.discard(robot)
            if known.get("incarnation") == incarnation and known.get("state") is State.DEAD:
                self.state(robot, State.ALIVE, now_us, now_us)
        if known.get("incarnation") == incarnation:
            return
        if self.started_us is None:
            self.started_us = now_us
        self.joined_us.setdefault(robot, now_us)
        previous = known.get("incarnation")
        if previous is not None and known.get("state") not in (State.DEAD, State.LEFT):
            # It is back before its death was noticed.
            fault = self._died(robot, previous, now_us)
            fault.detected_us = now_us
            self._settle(fault)
        # The end of an earlier life is not that of the next one.
        self._exits.pop(robot, None)
        for fault in self.major:
            if fault.robot == robot and fault.until_us is None:
                self._is_back(fault, now_us)
        known.update(incarnation=incarnation, state=State.ALIVE)
        self._say_heard(now_us, f"{robot} joined" if previous is None else f"{robot} is back")
        # It may have begun and ended work before its first heartbeat came here.
        for activation, of_life in self._early.pop(robot, ()):
            if of_life == incarnation:
                self._took_part(robot, activation)
        self._claimed(robot, now_us)

    def exited(self, robot: str, at_us: int) -> None:
        """The robot's process was killed, or seen to end: a better time than the last heartbeat.

        The end of a process is noticed a little late, so the earliest time counts.
        """
        if self.result is not None:
            return
        fault = next((f for f in self.major if f.robot == robot and f.until_us is None), None)
        if fault is not None:
            fault.at_us = min(at_us, fault.at_us) if fault.exact else at_us
            fault.exact = True
            self._find_takeover(fault)
            self._settle(fault)
        else:
            self._exits[robot] = min(at_us, self._exits.get(robot, at_us))

    def death_recorded(self, robot: str, incarnation: Incarnation, times: DeathTimes) -> None:
        """The record of the run has these times of a death; from now on they count here too."""
        self._known_times[robot, incarnation] = times
        for fault in self._faults_of(robot, incarnation)[-1:]:
            self._settle(fault)
            # It may have died before the claim of its replacement was heard, and not after.
            self._find_takeover(fault)

    def died_unseen(self, robot: str, now_us: int, at_us: int | None) -> None:
        """The robot's process has ended, and nobody was there to notice; the last sign of life that
        it gave was at `at_us`, if that is known.
        """
        known = self.robots.get(robot, {})
        incarnation = known.get("incarnation", known.get("described_by"))
        if incarnation is None or known.get("state") is State.LEFT or self.result is not None:
            return
        known["incarnation"] = incarnation
        if self._open_fault(robot, incarnation) is None:
            fault = self._died(robot, incarnation, now_us if at_us is None else min(at_us, now_us))
            fault.is_older = at_us is None and not fault.exact

    def declared_dead(self, robot: str, incarnation: Incarnation, now_us: int) -> None:
        """A robot of the team has declared another one dead."""
        known = self.robots.get(robot, {})
        if self.result is not None:
            return  # after the end robots stop one after the other, which is no fault
        seen = known.get("incarnation")
        if known.get("described_by") == incarnation and (seen is None or seen < incarnation):
            # It had joined, and died before its first heartbeat came here; an observer that is late
            # cannot know when.
            is_catching_up = self.is_catching_up
            self.is_catching_up |= bool(self.unwatched)
            exited_us = self._exits.get(robot)
            self.robot_seen(robot, incarnation, now_us)
            if exited_us is not None:
                self._exits[robot] = exited_us
            self._note_death(robot, incarnation, now_us)
            self.is_catching_up = is_catching_up
        elif seen == incarnation:
            self._note_death(robot, incarnation, now_us)

    def _note_death(self, robot: str, incarnation: Incarnation, now_us: int) -> None:
        fault = self._open_fault(robot, incarnation)
        has_left = robot in self._removed or self.robots[robot].get("state") is State.LEFT
        if fault is None and not has_left:
            fault = self._died(robot, incarnation, now_us)
        if fault is not None and (robot, incarnation) not in self._declared:
            self._declared.add((robot, incarnation))
            # The declaration may arrive after the claim of the replacement, which knew of it.
            known_us = now_us if fault.reassigned_us is None else fault.reassigned_us
            fault.detected_us = min(now_us, known_us)
            self._settle(fault)
            self._say_heard(now_us, f"{robot} is dead")

    def state(self, robot: str, state: State, evidence_us: int, now_us: int) -> None:
        """This observer's own view of a robot has changed."""
        known = self.robots.get(robot)
        if known is None or "incarnation" not in known or self.result is not None:
            return  # it never joined
        if state is State.DEAD and robot in self._removed:
            state = State.LEFT
        if state is State.DEAD:
            fault = self._open_fault(robot, known["incarnation"])
            if fault is None:
                self._died(robot, known["incarnation"], evidence_us)
            elif not fault.exact:
                fault.at_us = min(fault.at_us, evidence_us)
                self._find_takeover(fault)
                self._settle(fault)
        elif state is State.ALIVE:
            fault = self._open_fault(robot, known["incarnation"])
            if fault is not None:
                self._is_back(fault, now_us)
                self.say(now_us, f"{robot} is back")
        elif state is State.LEFT and known.get("state") is not State.LEFT:
            self.say(now_us, f"{robot} left")
        known["state"] = state

    def is_declared(self, robot: str) -> bool:
        """Whether another robot holds this one for dead."""
        return any(
            fault.robot == robot and fault.until_us is None and fault.detected_us is not None
            for fault in self.major
        )

    def in_doubt(self) -> list[str]:
        """The robots that are suspect here, or dead and not back in a later life."""
        doubted = (State.SUSPECT, State.DEAD)
        return [robot for robot, known in self.robots.items() if known.get("state") in doubted]

    def heard_again(self, robot: str, incarnation: Incarnation, heard_us: int, now_us: int) -> None:
        """Nobody holds a robot for dead that was heard at `heard_us`."""
        known = self.robots[robot]
        if known.get("incarnation") != incarnation:
            return
        fault = self._open_fault(robot, incarnation)
        # Where all robots were silent no other one has declared it dead.
        if fault is None or heard_us > (fault.detected_us or fault.at_us):
            self.state(robot, State.ALIVE, heard_us, now_us)

    def fact(self, entry: Entry, now_us: int) -> None:
        """An entry of the fact map has changed."""
        robot = entry.author
        self.task_log.fact(entry)
        self.job_log.fact(entry, now_us, self.is_catching_up)
        if (history := self._feature_of.get(entry.parts[0])) is not None:
            self._say_heard(now_us, history.fact(entry, now_us))
        match entry.record:
            case Member() as member:
                known = self.robots.setdefault(robot, {})
                self._lost(robot, known.get("lost", {}), member.lost, now_us)
                self._performs(robot, member, now_us)
                known.update(type=member.type, lost=member.lost, pid=member.pid, host=member.host)
                known["pending"] = member.pending
                known["described_by"] = entry.version.incarnation
                if member.is_leaving and known.get("state") is not State.DEAD:
                    known["state"] = State.LEFT
            case Claim() as claim:
                self._claim(robot, claim, entry.version.incarnation, now_us)
            case NoClaim():
                self._claims.pop(robot, None)
                self.work_log.given_up(robot, now_us)
            case Outcome() as outcome:
                _, activation, local_task, *_ = entry.parts
                self.task_log.took_part(robot, activation)
                self.work_log.outcome(robot, activation, local_task, outcome, now_us)
                how = "done" if outcome.success else "failed"
                why = f": {outcome.reason}" if outcome.reason else ""
                self._say_heard(now_us, f"{robot}: {local_task} {how}{why}")
                if not outcome.success:
                    at_us = None if self.is_catching_up else now_us
                    task = parse_activation(activation).subject
                    failure = FailedEnd(robot, task, local_task, at_us, outcome.reason)
                    self.failures.append(failure)
            case ConditionValue() as condition:
                name = entry.parts[1]
                self.conditions.append((now_us, name, condition.value))
                text = self.mission.entries.text(name, condition.value)
                self._say_heard(now_us, f"{robot}: {name} is {text}")
            case RobotProblem(text):
                self.problem(robot, entry.parts[1], text, now_us)
            case records.OperatorCommand() as command if entry.parts[0] in _SHOWN_COMMANDS:
                if entry.parts[0] == records.ABORTED and not self.is_catching_up:
                    self.job_log.over(now_us)
                text = records.command_text(entry.parts, command)
                self._say_heard(now_us, f"operator {command.operator}: {text}")

    def problem(self, robot: str, subject: str, text: str, now_us: int) -> None:
        """A robot's journal, or a part of its program, has this problem; empty: no longer."""
        before = self.problems.get((robot, subject))
        if text and before is not None and before.to_us is None and before.problem == text:
            return
        if text:
            self.problems[robot, subject] = ProblemEpisode(text, now_us)
            self._say_heard(now_us, f"{robot}: {problem_text(subject, text)}")
        elif before is not None and before.to_us is None:
            before.to_us = now_us
            self._say_heard(now_us, f"{robot}: {subject} works again")

    def plan(self, plan: Plan, now_us: int, settled: bool = True) -> None:
        """A new plan: the states of global tasks, and the blocked requests.

        While robots are joining (not `settled`), no request counts as blocked.
        """
        self.task_log.plan(plan)
        now_blocked = {w.global_task: w.reason for w in plan.waiting if w.is_blocked}
        for episode in self.blocked:
            if episode.to_us is None and now_blocked.get(episode.request) != episode.reason:
                episode.to_us = now_us
                self.say(now_us, f"{episode.request} is no longer blocked")
        self.blocked = [each for each in self.blocked if not each.is_brief]
        running = {episode.request for episode in self.blocked if episode.to_us is None}
        for request, reason in now_blocked.items():
            if settled and request not in running:
                self.blocked.append(BlockedEpisode(request, reason, now_us))
                self.say(now_us, f"{request} {reason}")

    def round_runs(self, now_us: int) -> None:
        """The team of a mission that never ends has work."""
        if self.rounds.running(now_us):
            self.say(now_us, f"round {self.rounds.all.total} begins")

    def round_over(self, result: Status, now_us: int) -> None:
        """The team of a mission that never ends has come to a result, and stands by."""
        ended = self.rounds.ended(result, now_us)
        if ended is not None:
            took_s = (now_us - ended.from_us) / 1e6
            text = f"round {self.rounds.all.total}: {result.name.lower()} after {took_s:.1f} s"
            self.say(now_us, text)

    def over(self, result: Status, now_us: int) -> None:
        """The team has come to the mission's result."""
        if self.result is None:
            self.result = result
            self.ended_us = now_us
            self.job_log.over(now_us)
            self.say(now_us, f"mission: {result.name.lower()}")

    # -- conclusions ----------------------------------------------------------------------

    def _open_fault(self, robot: str, incarnation: Incarnation) -> MajorFault | None:
        found = self._faults_of(robot, incarnation)
        return found[-1] if found and found[-1].until_us is None else None

    def _settle(self, fault: MajorFault) -> None:
        """Its times have changed."""
        known = self._known_times.get((fault.robot, fault.incarnation))
        if known is not None:
            # One life may be held for dead several times.
            ends_us = [f.until_us for f in self._faults_of(fault.robot, fault.incarnation)]
            is_over = ends_us[-1] is not None and ends_us[-1] <= known.at_us
            if not is_over and all(end is not None and end <= known.at_us for end in ends_us[:-1]):
                if fault.exact and not known.exact:
                    known = replace(known, at_us=fault.at_us, exact=True)
                if known.reassigned_us is None:
                    reassigned_us, other = fault.reassigned_us, fault.replacement
                    known = replace(known, reassigned_us=reassigned_us, replacement=other)
                fault.times, fault.is_older = known, False
        if fault.until_us is None:
            self.work_log.died(fault.robot, fault.at_us)

    def _is_back(self, fault: MajorFault, now_us: int) -> None:
        fault.until_us = now_us
        self._declared.discard((fault.robot, fault.incarnation))

    def _faults_of(self, robot: str, incarnation: Incarnation) -> list[MajorFault]:
        return [f for f in self.major if (f.robot, f.incarnation) == (robot, incarnation)]

    def _died(self, robot: str, incarnation: Incarnation, at_us: int) -> MajorFault:
        held = self._claims.get(robot)
        claim = held[0] if held is not None and held[1] == incarnation else None
        exact = robot in self._exits
        at_us = self._exits.pop(robot, at_us)
        fault = MajorFault(robot, incarnation, at_us, claim, exact=exact)
        fault.is_older = self.is_catching_up and not exact
        self.major.append(fault)
        self.robots[robot]["state"] = State.DEAD
        self._find_takeover(fault)
        self._settle(fault)
        return fault

    def _find_takeover(self, fault: MajorFault) -> None:
        """The robots knew first: the claim of the replacement may have arrived before the death."""
        for since_us, other, taken in self.claims:
            if since_us >= fault.at_us and other != fault.robot and taken.phase is Phase.RUNNING:
                self._takes_over(fault, other, taken, since_us)

    def _lost(
        self, robot: str, before: Mapping[str, str], after: Mapping[str, str], now_us: int
    ) -> None:
        for fault in self.minor:
            if fault.robot != robot or fault.until_us is not None:
                continue
            if not any(name in after for name in fault.local_tasks):
                fault.until_us = now_us
                self._say_heard(now_us, f"{robot} has {', '.join(fault.local_tasks)} again")
        for reason, names in texts_by_reason(after).items():
            fresh = tuple(name for name in names if name not in before)
            if fresh:
                self.minor.append(MinorFault(robot, fresh, reason, now_us))
            changed = [name for name in names if before.get(name) != reason]
            if changed:
                self._say_heard(now_us, f"{robot} {lost_text(changed, reason)}")

    def _performs(self, robot: str, member: Member, now_us: int) -> None:
        """Note the performances that differ from those of the mission."""
        known, changed = self.robots[robot], changed_performances(self.mission, robot, member)
        before = known.get("performances", {})
        known["performances"] = changed
        for name in sorted({*before, *changed}):
            if before.get(name) != changed.get(name):
                value = changed.get(name, member.capabilities.get(name, 0)) / MICRO
                self.say(now_us, f"{robot}: {name} at {value:g}")

    def _claim(self, robot: str, claim: Claim, incarnation: Incarnation, now_us: int) -> None:
        self._claims[robot] = (claim, incarnation)
        self.claims.append((now_us, robot, claim))
        if not self._claimed(robot, now_us) and claim.phase is Phase.RUNNING:
            early = self._early.setdefault(robot, deque(maxlen=MAX_EARLY))
            early.append((claim.activation, incarnation))

    def _claimed(self, robot: str, now_us: int) -> bool:
        """A claim counts once its incarnation is known to live: it may be of an earlier life.
        Return whether it does.
        """
        claim, incarnation = self._claims.get(robot, (None, None))
        if claim is None or self.robots.get(robot, {}).get("incarnation") != incarnation:
            return False
        span = self.work_log.claimed(robot, claim, now_us, self.is_catching_up)
        self.job_log.at_work(span)
        if claim.phase is Phase.TRAVELLING and self.mission.travel is not None:
            place = place_at(self.mission, claim.local_task)
            self._say_heard(now_us, f"{robot}: on its way to {place} for {claim.local_task}")
        if claim.phase is Phase.RUNNING:
            self._began(robot, claim, now_us)
        return True

    def _began(self, robot: str, claim: Claim, now_us: int) -> None:
        self._took_part(robot, claim.activation)
        for history in self.features:
            history.begun(robot, claim)
        self._say_heard(now_us, f"{robot}: {claim.local_task} for {claim.global_task}")
        for fault in self.major:
            if fault.robot != robot:
                self._takes_over(fault, robot, claim, now_us)

    def _took_part(self, robot: str, activation: str) -> None:
        self.task_log.took_part(robot, activation)
        self.rounds.took_part(robot)

    def _takes_over(self, fault: MajorFault, robot: str, claim: Claim, now_us: int) -> None:
        """The robot runs `claim`: if the dead one held that, this is its replacement."""
        held = fault.held
        if held is None or fault.reassigned_us is not None:
            return
        if (held.activation, held.local_task) == (claim.activation, claim.local_task):
            fault.reassigned_us, fault.replacement = now_us, robot
            if fault.detected_us is not None:
                fault.detected_us = min(fault.detected_us, now_us)
            self._settle(fault)

    def seconds(self, at_us: int | None) -> float | None:
        """A time of this record as seconds from the start; None if nobody has joined yet."""
        if at_us is None or self.started_us is None:
            return None
        return round((at_us - self.started_us) / 1e6, 6)
