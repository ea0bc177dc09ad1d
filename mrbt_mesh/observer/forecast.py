"""What the schedule in force foretells: where each robot goes, when, with whom, and why not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import Phase
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.planning.schedules import Lookahead
from mrbt_mesh.core.scheduling.problem import Course, Objective, SchedulingProblem, course_of
from mrbt_mesh.observer.observer import Observer


@dataclass(frozen=True, slots=True)
class ExpectedStep:
    """One task that a robot is to do, `partners` with it. `place`: empty if anywhere.

    `begins_s`, `ends_s`: its work, from now on.
    """

    activation: str
    global_task: str
    local_task: str
    place: str
    partners: tuple[str, ...]
    begins_s: float
    ends_s: float

    def __str__(self) -> str:
        partners = f" with {', '.join(self.partners)}" if self.partners else ""
        return f"{self.local_task}{partners} in {self.begins_s:.1f} s"


@dataclass(frozen=True, slots=True)
class RobotForecast:
    """Where a robot is, or from which `place` it has set out for its `goal`, and what it will do.

    `work`: the local task at which it works now, for `work_s` more; empty and 0 without one.
    """

    place: str
    goal: str
    work: str
    work_s: float
    steps: tuple[ExpectedStep, ...]

    @property
    def where(self) -> str:
        """For people: `dock -> shelf_2`."""
        return f"{self.place} -> {self.goal}" if self.goal else self.place

    def next_text(self, most: int = 2) -> str:
        """For people: `lift(2) in 1.2 s, then lift(5) with R1 in 4.1 s`."""
        texts = [f"{self.work} for {self.work_s:.1f} s more"] if self.work else []
        texts += map(str, self.steps)
        more = f", and {len(texts) - most} more" if len(texts) > most else ""
        return ", then ".join(texts[:most]) + more


@dataclass(frozen=True, slots=True)
class Forecast:
    """Of a team that travels. Without a schedule in force `reason` says why, `ends_s` is None, and
    robots have no steps.

    `author` has proposed it, nobody if it is empty. `ends_s`: when the last of its tasks has ended,
    and all robots are back if they return. `left_out`: (global task, why schedules leave it out).
    """

    objective: str
    author: str
    reason: str
    ends_s: float | None
    robots: Mapping[str, RobotForecast]
    left_out: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        return self.reason + ("" if self.ends_s is None else f", ends in {self.ends_s:.1f} s")

    @property
    def next_s(self) -> float:
        """Until something is expected to begin or to end; infinite if nothing is."""
        robots = self.robots.values()
        ends = [robot.work_s for robot in robots if robot.work]
        return min(ends + [step.begins_s for robot in robots for step in robot.steps], default=inf)

    def to_json(self) -> dict[str, Any]:
        """Plain data, with texts for people: `text`, and of each robot `where` and `next`."""
        robots = {
            name: asdict(robot) | {"where": robot.where, "next": robot.next_text()}
            for name, robot in self.robots.items()
        }
        left_out = [{"global_task": task, "reason": why} for task, why in self.left_out]
        return asdict(self) | {"robots": robots, "left_out": left_out, "text": str(self)}


def forecast(
    facts: TeamFacts, ahead: Lookahead, elapsed_ms: Mapping[str, int] | None = None
) -> Forecast:
    """The forecast of now. `elapsed_ms`: for how long each robot has worked or been on its way;
    where that is not known, work is taken to be half done, and of a way what the robot said last.
    """
    travel = facts.mission.travel
    assert travel is not None
    problem = _now(facts, ahead, elapsed_ms or {})
    steps: dict[str, list[ExpectedStep]] = {robot: [] for robot in ahead.robots}
    ends_s = None
    if ahead.schedule is not None:
        course = course_of(problem, ahead.schedule)
        _put_steps(facts, ahead, course, steps)
        whole = replace(problem, objective=Objective.MAKESPAN)
        ends_ms = max(course_of(whole, ahead.schedule).cost, *problem.free_ms)
        ends_s = ends_ms / 1_000
    robots = {}
    for robot, free_ms in zip(ahead.robots, problem.free_ms, strict=True):
        claim = facts.valid_claim(robot)
        is_at_work = claim is not None and claim.phase is Phase.RUNNING
        robots[robot] = RobotForecast(
            facts.place_of(robot),
            facts.under_way(robot),
            claim.local_task if claim is not None and is_at_work else "",
            free_ms / 1_000,
            tuple(steps[robot]),
        )
    return Forecast(
        str(travel.objective),
        ahead.author,
        _reason(ahead, travel.objective),
        ends_s,
        robots,
        tuple((parse_activation(name).subject, why) for name, why in ahead.left_out.items()),
    )


def forecast_of(observer: Observer, now_us: int) -> Forecast | None:
    """The forecast of a team that is watched; None where nothing lies ahead of one that travels."""
    plan = observer.plan
    if plan is None or plan.ahead is None:
        return None
    elapsed_ms = {}
    for robot in plan.ahead.robots:
        span = observer.record.work_log.latest(robot)
        if span is not None and not span.is_older:
            begun_us = span.claimed_us if span.running_us is None else span.running_us
            elapsed_ms[robot] = (now_us - begun_us) // 1_000
    return forecast(observer.facts, plan.ahead, elapsed_ms)


def _reason(ahead: Lookahead, objective: Objective) -> str:
    if ahead.schedule is not None:
        count = len(ahead.schedule)
        tasks = "1 task" if count == 1 else f"{count} tasks"
        return f"schedule by {ahead.author or 'rules'} for {objective}, {tasks}"
    if not ahead.robots:
        return "no schedule: nobody knows where any robot is"
    return "no schedule: no task ahead lacks robots, or the horizon is 1"


def _now(facts: TeamFacts, ahead: Lookahead, elapsed_ms: Mapping[str, int]) -> SchedulingProblem:
    """The problem with the time that work and ways have taken. Facts count work as half done, and
    of ways what robots have said last.
    """
    free_ms, tables = list(ahead.problem.free_ms), list(ahead.problem.travel_ms)
    places = list(facts.mission.travel.places) if facts.mission.travel is not None else []
    for number, robot in enumerate(ahead.robots):
        if robot not in elapsed_ms:
            continue
        free_ms[number] = max(0, 2 * free_ms[number] - elapsed_ms[robot])
        if goal := facts.under_way(robot):
            *table, row = tables[number]
            left_ms = list(row)
            index = places.index(goal)
            whole_ms = table[places.index(facts.place_of(robot))][index]
            left_ms[index] = min(row[index], max(0, whole_ms - elapsed_ms[robot]))
            tables[number] = [*table, left_ms]
    return replace(ahead.problem, free_ms=tuple(free_ms), travel_ms=tables)


def _put_steps(
    facts: TeamFacts, ahead: Lookahead, course: Course, steps: dict[str, list[ExpectedStep]]
) -> None:
    travel = facts.mission.travel
    assert travel is not None
    for step, begin_ms, end_ms in zip(
        ahead.schedule or (), course.begins_ms, course.ends_ms, strict=True
    ):
        each, members = ahead.opens[step.task], ahead.members(step)
        for demand, robots in zip(each.group, step.crew, strict=True):
            for robot in (ahead.robots[number] for number in robots):
                steps[robot].append(
                    ExpectedStep(
                        each.request.activation,
                        each.request.subject,
                        demand.local_task,
                        travel.at.get(demand.local_task, ""),
                        tuple(name for name in members if name != robot),
                        begin_ms / 1_000,
                        end_ms / 1_000,
                    )
                )
