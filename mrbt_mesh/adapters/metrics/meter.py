"""Counts the inputs and effects of one agent; it changes nothing."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from mrbt_mesh.adapters.metrics.families import Distribution, Labels, robot_label, task_label
from mrbt_mesh.core.agent.effects import (
    Ask,
    Effect,
    Log,
    Persist,
    Publish,
    Reply,
    StartAction,
)
from mrbt_mesh.core.agent.inputs import (
    AnswerReceived,
    Input,
    InputBatch,
    MessageReceived,
    QueryReceived,
)
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.facts.records import Claim, Outcome
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.wire import MessageKind
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.make_plan import PlanFunction
from mrbt_mesh.core.planning.plan import Plan

KINDS = {kind: kind.name.lower() for kind in MessageKind}
# The kind of a reply to a query or a command.
REPLY = "reply"


class Traffic:
    """Numbers of messages and of their bytes, by kind."""

    def __init__(self) -> None:
        self.messages: Counter[str] = Counter()
        self.bytes: Counter[str] = Counter()

    def count(self, kind: str, data: bytes) -> None:
        """Count one message."""
        self.messages[kind] += 1
        self.bytes[kind] += len(data)


class Meter:
    """The counts of one robot's process since it started.

    `claims`: facts about its work, by local task and phase; `outcomes`: by local task and result.
    `suspicions` and `deaths`: declared by this robot, by robot. `plan_s`, `lag_s` and `sync_s`:
    durations of planning, of the event loop's delays, of synced writes to the journal.
    `started_s`: when the running local task started, by `time.monotonic`. `agreed_since_s`: Unix
    time at which agreement with all robots last began or ended.
    """

    def __init__(self, robot: str, mission: Mission) -> None:
        self.robot = robot
        self.mission = mission
        self.received = Traffic()
        self.sent = Traffic()
        self.claims: Counter[Labels] = Counter()
        self.outcomes: Counter[Labels] = Counter()
        self.suspicions: Counter[str] = Counter()
        self.deaths: Counter[str] = Counter()
        self.fencings = 0
        self.dropped = 0
        self.plan_s = Distribution()
        self.lag_s = Distribution()
        self.sync_s = Distribution()
        self.started_s = 0.0
        self._agrees: bool | None = None
        self.agreed_since_s = 0.0

    # -- what passes the driver ---------------------------------------------------------------

    def take(self, event: Input) -> None:
        """Count an input that is passed to the agent."""
        if isinstance(event, MessageReceived):  # most are
            self.received.count(KINDS[event.kind], event.data)
        elif isinstance(event, InputBatch):
            for each in event.inputs:
                self.take(each)
        elif isinstance(event, QueryReceived):
            self.received.count(KINDS[event.kind], event.data)
        elif isinstance(event, AnswerReceived) and event.data is not None:
            self.received.count(REPLY, event.data)

    def carry_out(self, effect: Effect) -> None:
        """Count an effect that the driver carries out."""
        if isinstance(effect, Publish):  # most are
            self.sent.count(KINDS[effect.kind], effect.data)
            return
        match effect:
            case Ask(_, data):
                self.sent.count(KINDS[MessageKind.PULL], data)
            case Reply(_, pages):
                for page in pages:
                    self.sent.count(REPLY, page)
            # Entries of several versions are all facts written again after the journal was lost.
            case Persist(entries) if len({entry.version for entry in entries}) == 1:
                for entry in entries:
                    if entry.author == self.robot:
                        self._wrote(entry)
            case StartAction():
                self.started_s = time.monotonic()
            case Log(_, event, fields):
                self._logged(event, fields)
            case _:
                pass

    def _wrote(self, entry: Entry) -> None:
        match entry.record:
            case Claim(_, _, local_task, phase):
                self.claims[task_label(self.mission, local_task), phase.name.lower()] += 1
            case Outcome(success):
                result = "success" if success else "failure"
                self.outcomes[task_label(self.mission, entry.parts[2]), result] += 1
            case _:
                pass

    def _logged(self, event: str, fields: Mapping[str, object]) -> None:
        if event == "fenced":
            self.fencings += 1
        elif event in ("robot_suspect", "robot_dead"):
            counter = self.suspicions if event == "robot_suspect" else self.deaths
            counter[robot_label(self.mission, str(fields["robot"]))] += 1

    # -- what is looked at regularly ----------------------------------------------------------

    def look(self, lag_s: float, agrees: bool) -> None:
        """Note the delay of the event loop, and whether all robots agree with this one."""
        self.lag_s.observe(max(0.0, lag_s))
        if agrees is not self._agrees:
            self._agrees = agrees
            self.agreed_since_s = time.time()

    # -- plans --------------------------------------------------------------------------------

    def timed(self, engine: Engine) -> Engine:
        """Return the same engine, but measuring the time of each plan."""

        def timed_planning(solver: Solver) -> PlanFunction:
            make_plan = engine.plan_making(solver)

            def timed_plan(facts: TeamFacts, alive: Mapping[str, Incarnation]) -> Plan:
                began_s = time.perf_counter()
                plan = make_plan(facts, alive)
                self.plan_s.observe(time.perf_counter() - began_s)
                return plan

            return timed_plan

        return replace(engine, plan_making=timed_planning)
