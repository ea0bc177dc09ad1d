"""Random missions with conditions, sets of faults, and ways in which actions may end; what comes of
them by the definition of a tick alone, by `mrbt analyze`, and in the simulator.

A case is one run: which robots and capabilities are lost, which conditions hold, and how each
action ends if there are robots for it. The three must agree in every case.
"""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import anyio

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.analysis.tolerance.readings import serial
from mrbt_mesh.analysis.tolerance.service import Fault, FaultyTeam, capability_faults, robot_faults
from mrbt_mesh.core.bt.evaluation import PresentFacts
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec, Status, build_tree
from mrbt_mesh.core.mission.mission import (
    MICRO,
    FailurePolicy,
    GlobalTask,
    Mission,
    Need,
    SameRobotAs,
)
from mrbt_mesh.sim import Kill, Lose, Schedule, simulate
from mrbt_mesh.sim.world.faults import Operate
from tests.support.build import SECOND_US, jointly, make_mission

MAX_TASKS, MAX_CONDITIONS = 5, 3
# Robots that the team has met are lost while it rests by command, before any action has ended.
PAUSE_US, STRIKE_US, RESUME_US = SECOND_US // 4, SECOND_US // 2, 6 * SECOND_US
# Longer than anything in a case takes that does not wait for ever.
TIMEOUT_US = 60 * SECOND_US
# How an action ends: it may also go on until a Timeout ends it.
SUCCESS, FAILURE, NEVER = "success", "failure", "never"
Outcomes = Mapping[str, str]
robot = RobotProgram()


@robot.local_task("*")
async def work(task: TaskContext, *arguments: str) -> bool:
    """A second of work, then what the parameters say of the global task: it fails at one need."""
    end = task.parameters["ends"][task.global_task]
    await anyio.sleep(1.0 if end != NEVER else 10_000.0)
    return bool(end == SUCCESS or task.local_task != task.parameters["fails_at"][task.global_task])


@dataclass(frozen=True)
class Case:
    """One run. `are_known`: the team had met the robots that died, and what was lost.

    `are_distinct`: each condition is asked at one place. `is_possible`: there are ends with which
    the mission would succeed if there were robots for everything.
    """

    seed: int
    mission: Mission
    faults: frozenset[Fault]
    are_known: bool
    ends: Outcomes
    are_distinct: bool = True
    is_possible: bool = True

    def __str__(self) -> str:
        lost = sorted(map(str, self.faults))
        holding = sorted(n for n, c in self.mission.conditions.items() if c.default)
        able = {r.id: list(r.capabilities) for r in self.mission.robots.values()}
        tasks = [*self.mission.global_tasks.values()]
        return (
            f"seed {self.seed}: lost {lost}, known: {self.are_known}, true: {holding}, "
            f"ends: {dict(self.ends)}, robots: {able}, tasks: {tasks}\n{drawn(self.mission)}"
        )


def drawn(mission: Mission) -> str:
    """The tree, indented."""
    depths: dict[int, int] = {}
    lines = []
    for node in mission.tree.nodes:
        depths[node.index] = depths.get(node.parent, -1) + 1
        lines.append("  " * depths[node.index] + node.label)
    return "\n".join(lines)


# -- drawing ----------------------------------------------------------------------------------


class _Drawing:
    def __init__(self, seed: int, is_bound: bool) -> None:
        self.pick = random.Random(f"{seed}/tolerance")
        self.bind = random.Random(f"{seed}/bound to")
        self.tasks: list[GlobalTask] = []
        self.conditions: list[str] = []
        self.local_tasks = [f"l{number}" for number in range(self.pick.randint(1, 3))]
        self.has_timeouts = self.pick.random() < 0.15 and not is_bound
        self.are_known = self.pick.random() < 0.7
        self.are_distinct = True
        self.is_bound = is_bound
        self.most = (3, 2) if is_bound else (MAX_TASKS, MAX_CONDITIONS)

    def robots(self) -> dict[str, dict[str, float]]:
        names = [f"R{number}" for number in range(1, self.pick.randint(2, 4) + 1)]
        return {
            name: {each: 1.0 for each in self.local_tasks if self.pick.random() < 0.6}
            for name in names
        }

    def task(self) -> NodeSpec:
        name, pick = f"g{len(self.tasks)}", self.pick
        chosen = pick.sample(self.local_tasks, min(len(self.local_tasks), pick.choice([1, 1, 2])))
        needs = []
        for local_task in chosen:
            least = pick.choice([1, 1, 1, 2])
            needs.append(Need(local_task, least, least + pick.choice([0, 0, 1])))
        if self.is_bound and self.tasks and self.bind.random() < 0.6:
            needs[0] = replace(needs[0], same_robot_as=self.before())
        failure, starts_together = pick.choice(list(FailurePolicy)), pick.random() < 0.2
        self.tasks.append(
            GlobalTask(
                name,
                tuple(needs),
                failure,
                SECOND_US if pick.random() < 0.3 else None,
                joint=jointly(
                    simultaneous=starts_together,
                    # A robot that dies in the middle would leave it in doubt.
                    exclusive=not self.are_known and pick.random() < 0.1 and not self.is_bound,
                ),
            )
        )
        return NodeSpec(Kind.ACTION, subject=name)

    def before(self) -> SameRobotAs:
        """A local task of an earlier global task."""
        task = self.bind.choice(self.tasks)
        return SameRobotAs(task.id, self.bind.choice(task.needs).local_task)

    def leaf(self) -> NodeSpec:
        """At most `most` different ones; then the same conditions are asked again."""
        if len(self.conditions) < self.most[1] and self.pick.random() < 0.3:
            self.conditions.append(f"c{len(self.conditions)}")
            return NodeSpec(Kind.CONDITION, subject=self.conditions[-1])
        if len(self.tasks) < self.most[0] or not self.conditions:
            return self.task()
        self.are_distinct = False
        return NodeSpec(Kind.CONDITION, subject=self.pick.choice(self.conditions))

    def node(self, depth: int) -> NodeSpec:
        pick = self.pick
        if depth > 2 or pick.random() < 0.2:
            return self.leaf()
        if pick.random() < 0.25:
            return self.decorator(depth)
        kind = pick.choice([Kind.SEQUENCE, Kind.FALLBACK, Kind.FALLBACK, Kind.PARALLEL])
        children = tuple(self.node(depth + 1) for _ in range(pick.choice([2, 2, 3])))
        if pick.random() < 0.15 and kind is Kind.SEQUENCE:
            kind = Kind.IF_THEN_ELSE
        memory = pick.choice([Memory.NONE, Memory.NONE, Memory.WHILE_RUNNING])
        limit = pick.randint(1, len(children)) if kind is Kind.PARALLEL else 0
        return NodeSpec(kind, children, limit=limit, memory=memory)

    def decorator(self, depth: int) -> NodeSpec:
        kinds = [Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE, Kind.RETRY, Kind.REPEAT]
        kind = self.pick.choice([*kinds, *[Kind.TIMEOUT] * 3] if self.has_timeouts else kinds)
        child = self.node(depth + 1)
        if kind in (Kind.RETRY, Kind.REPEAT):
            return NodeSpec(kind, (child,), limit=2)
        if kind is Kind.TIMEOUT:
            return NodeSpec(kind, (child,), timeout_us=TIMEOUT_US)
        return NodeSpec(kind, (child,))

    def faults(self, mission: Mission) -> frozenset[Fault]:
        """Some, of both kinds; now and then nobody lives."""
        majors = [fault for fault in robot_faults(mission) if self.pick.random() < 0.3]
        minors = [fault for fault in capability_faults(mission) if self.pick.random() < 0.2]
        if self.bind.random() < 0.05:
            return frozenset(robot_faults(mission))
        return frozenset([*majors[: len(mission.robots) - 1], *minors])


def cases(seed: int, is_bound: bool = False) -> Iterator[Case]:
    """Those of one mission with one set of faults: one for each choice of its conditions.

    `is_bound`: with tasks for the robots that did another one (`same_robot_as`).
    """
    drawing = _Drawing(seed, is_bound)
    robots = drawing.robots()
    tree = drawing.node(0)
    mission = make_mission(tree, robots, drawing.tasks, name=f"case{seed}")
    faults = drawing.faults(mission)
    for values in itertools.product((False, True), repeat=len(drawing.conditions)):
        holding = [n for n, value in zip(drawing.conditions, values, strict=True) if value]
        chosen = make_mission(tree, robots, drawing.tasks, holding, mission.name)
        first = Case(seed, chosen, faults, drawing.are_known, {}, drawing.are_distinct)
        ways = [replace(first, ends=ends) for ends in _ways_to_end(chosen)]
        good = [case for case in ways if foreseen_of_all(case) is Status.SUCCESS]
        possible = any(foreseen(case, is_ideal=True) is Status.SUCCESS for case in good or ways)
        yield replace(drawing.pick.choice(good or ways), is_possible=possible)


# -- by the definition of a tick --------------------------------------------------------------


def _ways_to_end(mission: Mission) -> Iterator[Outcomes]:
    """Every choice of ends for the actions. One that nothing ends would be no more than blocked."""
    tasks, under = [node.subject for node in mission.tree.actions()], _under_timeouts(mission)
    choices = [(SUCCESS, FAILURE, *([NEVER] if task in under else [])) for task in tasks]
    for chosen in itertools.product(*choices):
        yield dict(zip(tasks, chosen, strict=True))


def _under_timeouts(mission: Mission) -> set[str]:
    nodes = mission.tree.nodes
    found = set()
    for node in mission.tree.actions():
        above = node.parent
        while above >= 0:
            if nodes[above].kind is Kind.TIMEOUT:
                found.add(node.subject)
            above = nodes[above].parent
    return found


Doers = Mapping[SameRobotAs, frozenset[str]]


def foreseen_of_all(case: Case) -> Status:
    """What is foreseen if others are bound to the robots that do a task: the first end that is
    none with success.

    They may be any that could before the faults: some of them may come in between.
    """
    befores = {
        need.same_robot_as
        for task in case.mission.global_tasks.values()
        for need in task.needs
        if need.same_robot_as
    }
    choices = []
    for each in sorted(befores, key=str):
        needs = case.mission.global_tasks[each.global_task].needs
        count = next(need.min_robots for need in needs if need.local_task == each.local_task)
        robots = case.mission.robots.values()
        could = [robot.id for robot in robots if each.local_task in robot.capabilities]
        chosen = itertools.combinations(could, min(count, len(could)))
        choices.append([(each, frozenset(robots)) for robots in chosen])
    found = (foreseen(case, dict(chosen)) for chosen in itertools.product(*choices))
    return next((status for status in found if status is not Status.SUCCESS), Status.SUCCESS)


def foreseen(case: Case, doers: Doers | None = None, is_ideal: bool = False) -> Status:
    """The mission's status in the end, RUNNING if it stays blocked: by ticks of the tree alone.

    `doers`: who did what others are bound to. `is_ideal`: as if there were robots for everything.
    """
    if len(case.faults & case.mission.robots.keys()) == len(case.mission.robots) and not is_ideal:
        return Status.RUNNING
    facts = _Foreseen(case, doers or {}, is_ideal)
    evaluator = case.mission.evaluator
    while True:
        evaluation = evaluator.evaluate(facts)
        facts.attempts.update(evaluation.attempts)
        facts.children.update(((s, p), success) for s, p, success in evaluation.child_results)
        if evaluation.status is not Status.RUNNING:
            return evaluation.status
        ended = [(r.activation, facts.end(r.subject)) for r in evaluation.requests]
        news = {activation: status for activation, status in ended if status is not Status.RUNNING}
        expired = {timeout.activation for timeout in evaluation.timeouts} - facts.expired
        if news:
            activation = next(iter(news))
            facts.statuses[activation] = news[activation]
            subject = next(r.subject for r in evaluation.requests if r.activation == activation)
            facts.last[subject] = news[activation]
        elif expired:
            facts.expired |= expired
        else:
            return Status.RUNNING


class _Foreseen(PresentFacts):
    """What the tree reads: actions end as the case says, if there are robots for them."""

    def __init__(self, case: Case, doers: Doers, is_ideal: bool) -> None:
        self._case = case
        self._doers = doers
        self._is_ideal = is_ideal
        self.last: dict[str, Status] = {}
        self.statuses: dict[str, Status] = {}
        self.attempts: dict[str, int] = {}
        self.children: dict[tuple[str, int], bool] = {}
        self.expired: set[str] = set()

    def end(self, subject: str) -> Status:
        """How a requested task ends; RUNNING: it does not."""
        case, task = self._case, self._case.mission.global_tasks[subject]
        befores = [need.same_robot_as for need in task.needs if need.same_robot_as]
        is_done = all(self.last.get(each.global_task) is Status.SUCCESS for each in befores)
        if not (self._is_ideal or (is_done and _are_enough(case, task, self._doers))):
            fails = task.blocked_fail_after_us is not None and _may_decide(case, task)
            return Status.FAILURE if fails else Status.RUNNING
        if case.ends[subject] == SUCCESS:
            return Status.SUCCESS
        if case.ends[subject] == NEVER:
            return Status.RUNNING
        return Status.FAILURE

    def condition(self, name: str) -> bool:
        return self._case.mission.entries.default(name)

    def task_status(self, subject: str, activation: str) -> Status:
        return self.statuses.get(activation, Status.RUNNING)

    def attempts_used(self, activation: str) -> int:
        return self.attempts.get(activation, 0)

    def has_expired(self, activation: str) -> bool:
        return activation in self.expired

    def child_result(self, activation: str, position: int) -> Status | None:
        success = self.children.get((activation, position))
        return None if success is None else Status.SUCCESS if success else Status.FAILURE


def _able(case: Case, local_task: str) -> list[str]:
    """The robots that can still do it."""
    return [
        robot.id
        for robot in case.mission.robots.values()
        if local_task in robot.capabilities and not case.faults & {robot.id, (robot.id, local_task)}
    ]


def _may_decide(case: Case, task: GlobalTask) -> bool:
    """What is exclusive is decided by a majority only."""
    alive = sum(robot not in case.faults for robot in case.mission.robots)
    return not task.at_most_once or 2 * alive > len(case.mission.robots)


def _are_enough(case: Case, task: GlobalTask, doers: Doers) -> bool:
    """Whether there are different robots for all that it needs at one time: by trying all out."""
    if not _may_decide(case, task):
        return False
    slots = []
    for need in task.needs:
        able = set(_able(case, need.local_task))
        if need.same_robot_as:
            able &= doers[need.same_robot_as]
        slots += [sorted(able)] * need.min_robots

    def seat(number: int, taken: frozenset[str]) -> bool:
        return number == len(slots) or any(
            seat(number + 1, taken | {robot}) for robot in slots[number] if robot not in taken
        )

    return seat(0, frozenset())


# -- by the analysis --------------------------------------------------------------------------


def survives(mission: Mission, faults: frozenset[Fault]) -> bool:
    """What `mrbt analyze` says of these faults, whatever the conditions are."""
    return serial(mission).reading.survives(FaultyTeam(mission, faults))


def with_fixed_conditions(mission: Mission) -> Mission:
    """The same, where each condition always reads its default."""

    def fixed(spec: NodeSpec) -> NodeSpec:
        if spec.kind is Kind.CONDITION:
            holds = mission.entries.default(spec.subject)
            return NodeSpec(Kind.FORCE_SUCCESS if holds else Kind.FORCE_FAILURE, (spec,))
        return replace(spec, children=tuple(map(fixed, spec.children)))

    return replace(mission, tree=build_tree(fixed(mission.tree.spec(0))))


# -- in the simulator -------------------------------------------------------------------------


def simulated(case: Case, at_us: int | None = None, performances: int = 0) -> str:
    """The result of the run: `success`, `failure` or `blocked`.

    `at_us`: the faults happen then, whatever is going on, to robots of random `performances`.
    """
    tasks = case.mission.global_tasks.values()
    fails_at = {task.id: task.needs[0].local_task for task in tasks}
    parameters = {"ends": dict(case.ends), "fails_at": fails_at}
    mission = replace(case.mission, parameters=parameters)
    lost = {fault for fault in case.faults if not isinstance(fault, str)}
    dead = sorted(fault for fault in case.faults if isinstance(fault, str))
    strike_us = at_us or STRIKE_US
    strikes: list[Any] = [(strike_us, Kill(robot)) for robot in dead]
    strikes += [(strike_us, Lose(*fault)) for fault in sorted(lost) if fault[0] not in dead]
    schedule: Schedule = [(0, Kill(robot)) for robot in dead]
    if at_us is not None:
        pick = random.Random(f"{case.seed}/{performances}")
        robots = {name: _performing(mission, name, pick) for name in mission.robots}
        mission, schedule = replace(mission, robots=robots), strikes
    elif case.are_known and len(dead) < len(mission.robots):
        alive = next(robot for robot in sorted(mission.robots) if robot not in dead)
        pause, resume = Operate(alive, "paused", "pause"), Operate(alive, "paused", "resume")
        schedule = [(PAUSE_US, pause), *strikes, (RESUME_US, resume)]
    else:
        mission = replace(mission, robots={r: _without(mission, r, lost) for r in mission.robots})
    result = simulate(
        mission,
        robot,
        seed=case.seed,
        schedule=schedule,
        timeout_us=10 * TIMEOUT_US,
        stop_when_stuck=True,
        inspect=False,
    )
    if len(dead) == len(mission.robots) and at_us is None and not result.summary["duration_s"]:
        return "blocked"  # it was over before anybody could be lost, and faults come first
    return result.result


def _performing(mission: Mission, name: str, pick: random.Random) -> Any:
    known = mission.robots[name]
    able = {each: MICRO * pick.randint(1, 4) for each in known.capabilities}
    return replace(known, capabilities=able)


def _without(mission: Mission, name: str, lost: set[Any]) -> Any:
    known = mission.robots[name]
    able = {each: p for each, p in known.capabilities.items() if (name, each) not in lost}
    return replace(known, capabilities=able)
