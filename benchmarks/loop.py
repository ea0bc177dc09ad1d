"""How long a large team's planning keeps an agent's event loop from its beats.

One agent of a large team runs as a robot's process runs it: plans are made in a thread, large
assignments are solved in a process. The others are only their messages. Beside it a task asks for
the loop every millisecond; its delay is the loop's lag.
"""

from __future__ import annotations

import gc
import random
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import anyio
import anyio.lowlevel
import anyio.to_thread
from anyio.abc import TaskGroup

from benchmarks.large import RUN, WrittenFacts, large_mission
from benchmarks.registry import Benchmark, Result, Setting, Table
from mrbt_mesh.core.agent import effects as fx
from mrbt_mesh.core.agent import inputs
from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.agent.config import AgentConfig
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.facts.store import Entry, Incarnation
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.membership.replica import Replica
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import (
    Header,
    Heartbeat,
    MessageKind,
    SelfReport,
    encode,
    pack_entries,
    write_heartbeat,
)
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.planning.plan import Plan

SIZES = ((200, 1_000), (1_000, 10_000))
EVENTS, QUICK_EVENTS = 60, 16
STEP_S = 0.001
ME = "R0000"
REFERENCE = "plans made in the event loop"


class Others(WrittenFacts):
    """The other robots of a team, and their messages."""

    def __init__(self, mission: Mission) -> None:
        super().__init__(mission)
        self.replica = Replica(self.facts, self._header("r"), Timing(), "r")

    def _header(self, robot: str) -> Header:
        return Header(self.mission.digest[:16], self.mission.name, RUN, robot)

    def sent(self, batch: list[Entry]) -> inputs.MessageReceived:
        """The message with a batch of facts."""
        robot = batch[0].author
        data = encode(self._header(robot), MessageKind.FACT, pack_entries(batch))
        return inputs.MessageReceived(MessageKind.FACT, robot, data)

    def beat(self, robot: str, leaving: bool = False) -> inputs.MessageReceived:
        self.sequence += 1
        life = Incarnation(self.lives[robot], "n")
        digest = self.facts.map.digest()
        word = SelfReport(life, self.sequence, bytes(8), True, 3)
        beat = Heartbeat(word, leaving, digest, (3,) * 4, 0, (), {})
        data = write_heartbeat(beat, self._header(robot))
        return inputs.MessageReceived(MessageKind.HEARTBEAT, robot, data)

    def state(self) -> Iterator[inputs.AnswerReceived]:
        """The answer to somebody who knows nothing, page by page."""
        asker = Replica(TeamFacts(self.mission, RUN), self._header("asker"), Timing(), "n")
        for page in self.replica.answer_pull(asker.write_pull()):
            yield inputs.AnswerReceived("R0001", page)


@dataclass
class Lags:
    """Milliseconds: the agent's steps, and per event the longest time that the loop was late."""

    steps_ms: list[float] = field(default_factory=list)
    lags_ms: list[float] = field(default_factory=list)


class Robot:
    """One agent with its event loop; the events come from `others`."""

    def __init__(self, others: Others, apart: bool, group: TaskGroup) -> None:
        self.others = others
        mission = others.mission
        can = dict(mission.robots[ME].capabilities)
        config = AgentConfig(ME, "T", can, RUN, "n", default_solver, plans_apart=apart)
        self.agent = Agent(mission, config, 0)
        self.lags = Lags()
        self._now_us = 0
        self._group = group
        self._late_ms = 0.0
        group.start_soon(self._be_late)

    async def join(self) -> None:
        """Hear everybody, take in what is known, and plan."""
        rest = [robot for robot in self.others.mission.robots if robot != ME]
        for robot in rest:
            self.others.join(robot)
        await self.take(*map(self.others.beat, rest))
        await self.take(*self.others.state())
        for _ in range(3):
            self._now_us += Timing().detection_us // 2
            await self.take(*map(self.others.beat, rest))
        if self.agent.view.is_joining or self.agent.view.plan is None:
            raise AssertionError("the robot has not joined")

    @property
    def plan(self) -> Plan:
        assert self.agent.view.plan is not None
        return self.agent.view.plan

    async def take(self, *events: inputs.Input) -> None:
        """Take in what has come, and plan until nothing follows."""
        for each in events:
            self._step(each)
            await anyio.lowlevel.checkpoint()
        agent = self.agent
        while self._is_behind():
            if agent.view.awaited_plan is None:
                self._now_us = max(self._now_us, agent.next_deadline_us(self._now_us))
                self._step(inputs.TimerFired())
            await anyio.sleep(STEP_S)

    def _is_behind(self) -> bool:
        """Whether its last plan is not that of all it knows; not so before it has joined."""
        agent, now_us = self.agent, self._now_us
        if agent.view.awaited_plan is not None or agent.next_deadline_us(now_us) <= now_us:
            return True
        return not (agent.view.is_joining or agent.view.is_plan_current)

    async def event(self, *inputs: inputs.Input) -> None:
        """The same, as an event to be measured."""
        await anyio.sleep(2 * STEP_S)
        self._late_ms = 0.0
        await self.take(*inputs)
        await anyio.sleep(2 * STEP_S)
        self.lags.lags_ms.append(self._late_ms)

    def _step(self, event: inputs.Input) -> None:
        started_s = time.perf_counter()
        effects = self.agent.handle(event, self._now_us)
        self.lags.steps_ms.append((time.perf_counter() - started_s) * 1e3)
        for effect in effects:
            if isinstance(effect, fx.MakePlan):
                self._group.start_soon(self._make_plan, effect)

    async def _make_plan(self, effect: fx.MakePlan) -> None:
        plan = await anyio.to_thread.run_sync(effect.make)
        if effect.number == 1:
            gc.freeze()
        self._step(inputs.PlanMade(effect.number, plan))

    async def _be_late(self) -> None:
        while True:
            due_s = time.perf_counter() + STEP_S
            await anyio.sleep(STEP_S)
            self._late_ms = max(self._late_ms, (time.perf_counter() - due_s) * 1e3)


async def measure(mission: Mission, events: int, seed: int, apart: bool) -> tuple[Lags, Lags]:
    """Lags of joining, and of as many events."""
    gc.collect()
    gc.freeze()  # as a robot's process does
    others, pick = Others(mission), random.Random(f"{seed}/{mission.name}")
    skips = sorted(name for name in mission.conditions if name.startswith("done"))
    async with anyio.create_task_group() as group:
        robot = Robot(others, apart, group)
        await robot.join()
        joining, robot.lags = robot.lags, Lags()
        for number in range(events):
            steps, robot.lags.steps_ms = robot.lags.steps_ms, []
            lines = [line for line in robot.plan.assignments.values() if line.robot != ME]
            await robot.take(
                *(others.sent(others.begin(line)) for line in lines if not line.pinned)
            )
            robot.lags.steps_ms = steps
            line = pick.choice([x for x in robot.plan.assignments.values() if x.robot != ME])
            match number % 4:
                case 0:
                    await robot.event(others.sent(others.finish(line)))
                case 1:
                    await robot.event(others.beat(line.robot, leaving=True))
                    others.lives[line.robot] += 1
                    await robot.take(others.beat(line.robot), others.sent(others.join(line.robot)))
                case 2:
                    await robot.event(others.sent(others.begin(line)))
                case _:
                    await robot.event(others.sent(others.turn(pick.choice(skips), line.robot)))
        group.cancel_scope.cancel()
    return joining, robot.lags


def run(setting: Setting) -> Result:
    rows: list[dict[str, Any]] = []
    for robots, nodes in SIZES[: 1 if setting.quick else None]:
        mission = large_mission(robots, nodes, seed=setting.seed)
        events = QUICK_EVENTS if setting.quick else EVENTS
        for apart in (True, False):
            joining, lags = anyio.run(measure, mission, events, setting.seed, apart)
            rows.append(_row(mission, apart, joining, lags))
        setting.say(f"  {robots} robots, {nodes} nodes")
    return Result(
        REFERENCE,
        rows,
        [_table(rows)],
        notes=[
            "One agent of the team; all others are at work. A step is one call of the agent, which "
            "nothing else in its process can interrupt. Lag: how late the loop gave way to a task "
            "that asked for it every millisecond, at worst per event; the threads of one Python "
            "process take turns of up to 5 ms. Elapsed time, so a loaded machine adds to it."
        ],
    )


def _row(mission: Mission, apart: bool, joining: Lags, lags: Lags) -> dict[str, Any]:
    return {
        "robots": len(mission.robots),
        "nodes": len(mission.tree.nodes),
        "plans": "beside the loop" if apart else "in the loop",
        "step_median_ms": statistics.median(lags.steps_ms),
        "step_max_ms": max(lags.steps_ms),
        "lag_median_ms": statistics.median(lags.lags_ms),
        "lag_max_ms": max(lags.lags_ms),
        "joining_step_max_ms": max(joining.steps_ms),
    }


def _table(rows: Sequence[dict[str, Any]]) -> Table:
    names = ("step_median_ms", "step_max_ms", "lag_median_ms", "lag_max_ms", "joining_step_max_ms")
    head = ("robots", "nodes", "plans", "step", "worst step", "lag", "worst lag", "joining, worst")
    shown = [
        (str(row["robots"]), f"{row['nodes']:,}", row["plans"], *(f"{row[n]:.2f}" for n in names))
        for row in rows
    ]
    return Table("The event loop while a team is at work, ms", head, shown)


BENCHMARK = Benchmark("how long planning blocks the event loop", run)
