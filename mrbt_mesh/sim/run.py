"""`simulate`: one whole run of a mission in virtual time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.assignment.problem import Solver
from mrbt_mesh.core.assignment.solvers import default_solver
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim.engine.clock import VirtualLoop
from mrbt_mesh.sim.engine.failures import NO_FAILURES, FailureModel
from mrbt_mesh.sim.engine.faults import Schedule
from mrbt_mesh.sim.engine.network import NetworkKnobs
from mrbt_mesh.sim.engine.scenario import Scenario
from mrbt_mesh.sim.engine.world import Setup, World

DEFAULT_TIMEOUT_US = 600_000_000


class SimulationError(RuntimeError):
    """An agent, a robot's program or the simulator itself broke; the message has the seed."""


@dataclass(frozen=True)
class SimulationResult:
    """What came out of a run.

    `summary` is what `mrbt up --json` prints, `events` what the robots recorded themselves (the
    lines of events.jsonl), `violations` the invariants that did not hold, `checks` how often each
    one was checked. `done_twice` counts local tasks that succeeded more often than their `max`,
    `exclusive_done_twice` exclusive tasks that did. `stops` says why each agent stopped: (exit
    code, reason). `befallen` counts the faults of each kind. `agents` are those of the last
    processes, to be looked at.
    """

    seed: int
    result: str
    summary: Mapping[str, Any]
    events: list[dict[str, Any]]
    effect_log_digest: str
    effect_log: list[str]
    violations: list[str]
    checks: Mapping[str, int]
    done_twice: int
    exclusive_done_twice: int
    stops: Mapping[str, tuple[int, str]]
    befallen: Mapping[str, int]
    agents: Mapping[str, Agent]
    observer: Observer
    duration_us: int

    def write_events(self, path: Path) -> None:
        """Write events.jsonl; raises OSError."""
        lines = (json.dumps(event, sort_keys=True) + "\n" for event in self.events)
        path.write_text("".join(lines), encoding="utf-8")


def simulate(
    mission: Mission,
    program: RobotProgram,
    *,
    seed: int,
    robots: Iterable[str] | None = None,
    schedule: Schedule = (),
    network: NetworkKnobs | None = None,
    timing: Timing | None = None,
    timeout_us: int = DEFAULT_TIMEOUT_US,
    speed: float = 1.0,
    exit_when_done: bool = True,
    stop_when_stuck: bool = False,
    failures: FailureModel = NO_FAILURES,
    plan_delay_us: int | None = None,
    solver: Solver = default_solver,
    solvers: Mapping[str, Solver] | None = None,
    inspect: bool = True,
    keep_log: bool = False,
) -> SimulationResult:
    """Run `mission` with the robots (all of the file by default) in virtual time.

    The same arguments give the same run, effect for effect. With `plan_delay_us` a plan takes so
    long, during which its robot goes on beating. Without `inspect` nothing is checked
    and no effect log is kept, which is faster and changes nothing else. `solvers` are those of
    robots that have another one than `solver`. Raises ValueError for a
    robot that the mission does not have, SimulationError if an agent breaks.
    """
    team = tuple(sorted(mission.robots if robots is None else set(robots)))
    steps = tuple(schedule)
    named = {fault.robot for _, fault in steps if hasattr(fault, "robot")}
    for robot in sorted({*team, *named}):
        if robot not in mission.robots:
            known = ", ".join(sorted(mission.robots))
            raise ValueError(f"the mission has no robot {robot!r}; it has {known}")
    if not team or speed <= 0 or timeout_us <= 0:
        raise ValueError("a run needs a robot, a speed above 0 and a timeout above 0")
    setup = Setup(
        mission=mission,
        program=program,
        seed=seed,
        robots=team,
        timeout_us=timeout_us,
        schedule=steps,
        network=network or NetworkKnobs(),
        timing=timing or Timing(),
        speed=speed,
        exit_when_done=exit_when_done,
        stop_when_stuck=stop_when_stuck,
        failures=failures,
        plan_delay_us=plan_delay_us,
        solver=solver,
        solvers=solvers or {},
        inspect=inspect,
        keep_log=keep_log,
    )
    world = World(setup)
    _run(world)
    return _result(world)


def run_scenario(
    mission: Mission, program: RobotProgram, scenario: Scenario, *, keep_log: bool = False
) -> SimulationResult:
    """`simulate` with the faults, the network and the robots of a scenario."""
    return simulate(
        mission,
        program,
        seed=scenario.seed,
        robots=scenario.robots,
        schedule=scenario.steps,
        plan_delay_us=scenario.plan_delay_us,
        network=scenario.network,
        timeout_us=scenario.timeout_us,
        speed=scenario.speed,
        exit_when_done=not scenario.stays,
        keep_log=keep_log,
    )


def _run(world: World) -> None:
    options = {"loop_factory": lambda: VirtualLoop(world.clock)}
    try:
        anyio.run(world.main, backend_options=options)
    except Exception as error:
        at_s = world.clock.now_us / 1e6
        text = f"seed {world.setup.seed}, at {at_s:.6f} s: {type(error).__name__}: {error}"
        raise SimulationError(text) from error


def _result(world: World) -> SimulationResult:
    observer, now_us = world.observer, world.clock.now_us
    if world.gave_up and not world.cut_off and world.network.is_reliable_at(now_us):
        world.inspection.never_stopped()
    if world.timed_out and observer.record.result is None:
        world.inspection.timed_out()
    result = observer.result(anybody_lives=bool(world.living()))
    processes = world.processes
    return SimulationResult(
        seed=world.setup.seed,
        result=result,
        summary=observer.record.summary(result, now_us),
        events=world.events,
        effect_log_digest=world.inspection.effect_log_digest,
        effect_log=list(world.inspection.effect_log),
        violations=list(world.inspection.violations),
        checks=dict(world.inspection.checks),
        done_twice=world.inspection.done_twice,
        exclusive_done_twice=world.inspection.exclusive_done_twice,
        stops={r: (p.stop.code, p.stop.reason) for r, p in processes.items() if p.stop},
        befallen=dict(world.befallen),
        agents={r: p.agent for r, p in processes.items() if p.agent},
        observer=observer,
        duration_us=now_us,
    )
