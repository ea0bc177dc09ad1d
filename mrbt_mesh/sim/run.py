"""`simulate`: one whole run of a mission in virtual time."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import anyio

from mrbt_mesh.core.agent.agent import Agent
from mrbt_mesh.core.assignment.problem import require_planner
from mrbt_mesh.core.engine import Engine
from mrbt_mesh.core.membership.keys import Keys
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.runtime.robot_loop import LoopWatchdog
from mrbt_mesh.runtime.solver_loader import chosen_engine
from mrbt_mesh.runtime.user_code import UserCall, place_of
from mrbt_mesh.sim.checkers.checkers import Checkers
from mrbt_mesh.sim.checkers.comparison import PlanComparison
from mrbt_mesh.sim.world.clock import VirtualLoop
from mrbt_mesh.sim.world.faults import EndRouter, Revise, RobotFault, Schedule, StartRouter
from mrbt_mesh.sim.world.network import NetworkKnobs
from mrbt_mesh.sim.world.process import Inspection
from mrbt_mesh.sim.world.scenario import Scenario
from mrbt_mesh.sim.world.setup import NO_FAILURES, AgentOptions, Beginning, FailureModel, Setup
from mrbt_mesh.sim.world.sharing import shared_engine
from mrbt_mesh.sim.world.team_commands import Propose, Refusal
from mrbt_mesh.sim.world.world import LookOn, World

DEFAULT_TIMEOUT_US = 600_000_000
# A step of a program's code that takes longer, in real time, fails.
BLOCK_LIMIT_S = 1.0


class SimulationError(RuntimeError):
    """An agent, a robot's program or the simulator itself broke; the message has the seed."""


@dataclass(frozen=True)
class SimulationResult:
    """What came out of a run.

    `summary` is what `mrbt up --json` prints, `events` what the robots recorded themselves (the
    lines of events.jsonl), `violations` the invariants that did not hold, `checks` how often each
    one was checked. `done_twice` counts local tasks that succeeded more often than their `max`,
    `exclusive_done_twice` exclusive tasks that did. `stops`: why each agent stopped, (exit
    code, reason). `fault_counts`: how many faults of each kind there were. `refusals`: commands to
    the team that came to nothing. `agents` are those of the last processes, to be looked at.
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
    fault_counts: Mapping[str, int]
    refusals: list[Refusal]
    agents: Mapping[str, Agent]
    observer: Observer
    duration_us: int

    def write_events(self, path: Path) -> None:
        """Write events.jsonl; raises OSError."""
        lines = (json.dumps(event, sort_keys=True) + "\n" for event in self.events)
        path.write_text("".join(lines), encoding="utf-8")


def _named_by_revisions(faults: list[Revise]) -> set[str]:
    if not faults:
        return set()
    from mrbt_mesh.features.revisions.commands import robots_of

    return {robot for fault in faults for robot in robots_of(fault)}


def simulate(
    mission: Mission,
    program: RobotProgram,
    *,
    seed: int,
    robots: Iterable[str] | None = None,
    schedule: Schedule = (),
    failures: FailureModel = NO_FAILURES,
    network: NetworkKnobs | None = None,
    agents: AgentOptions | None = None,
    timeout_us: int = DEFAULT_TIMEOUT_US,
    speed: float = 1.0,
    noise_permille: int = 0,
    stop_when_stuck: bool = False,
    until_jobs_end: bool = False,
    inspect: bool = True,
    keep_log: bool = False,
    record: Path | None = None,
    begin: Beginning | None = None,
    look_on: LookOn | None = None,
) -> SimulationResult:
    """Run `mission` with the robots (all of the file by default) in virtual time.

    The same arguments give the same run, effect for effect; what they mean: `Setup`. Without
    `inspect`, or with keys, nothing is checked and no effect log is kept, which is faster and
    changes nothing else. `keep_log`: keep the log's lines, not only their digest. `look_on` is
    shown the observer whenever that has seen something. `record`: the folder in which every robot,
    and the observer, records what it knows and does. `begin`: what has been before. Raises
    ValueError for a robot that the mission does not have and for a router that the network has not,
    SimulationError if an agent breaks, OSError where nothing can be recorded, MissingExtraError.
    """
    if inspect:
        require_planner("the simulator, which proves plans,")
    team = tuple(sorted(mission.robots if robots is None else set(robots)))
    steps = tuple(schedule)
    named = {fault.robot for _, fault in steps if isinstance(fault, RobotFault)}
    coming = {r for _, f in steps if isinstance(f, Propose) for r in f.mission.robots}
    coming |= _named_by_revisions([f for _, f in steps if isinstance(f, Revise)])
    for robot in sorted({*team, *named}):
        if robot not in mission.robots and robot not in coming:
            known = ", ".join(sorted(mission.robots))
            raise ValueError(f"the mission has no robot {robot!r}; it has {known}")
    unknown = {f.router for _, f in steps if isinstance(f, EndRouter | StartRouter)}
    unknown -= set(network.routers if network is not None else ())
    if unknown:
        raise ValueError(f"the network has no router {min(unknown)!r}")
    if not team or speed <= 0 or timeout_us <= 0:
        raise ValueError("a run needs a robot, a speed above 0 and a timeout above 0")
    setup = Setup(
        mission=mission,
        program=program,
        seed=seed,
        robots=team,
        timeout_us=timeout_us,
        schedule=steps,
        failures=failures,
        network=network or NetworkKnobs(),
        agents=agents or AgentOptions(),
        speed=speed,
        noise_permille=noise_permille,
        stop_when_stuck=stop_when_stuck,
        until_jobs_end=until_jobs_end,
        record=record,
        begin=begin,
    )
    if setup.agents.keys:
        # Messages are sealed: they can be neither checked nor shared.
        world = World(setup, lambda _: Inspection(), look_on)
    elif inspect:
        # What is checked, each robot must have computed for itself.
        comparison = PlanComparison(setup.agents.engine)
        setup = _with_engine(setup, comparison.engine)
        world = World(setup, lambda world: Checkers(world, comparison, keep_log), look_on)
    else:
        setup = _with_engine(setup, shared_engine(setup.header, setup.agents.engine))
        world = World(setup, lambda _: Inspection(), look_on)
    _run(world)
    return _result(world)


def run_scenario(
    mission: Mission,
    program: RobotProgram,
    scenario: Scenario,
    *,
    engine: Engine | None = None,
    keep_log: bool = False,
    record: Path | None = None,
    keys: Mapping[str, Keys] | None = None,
) -> SimulationResult:
    """`simulate` with the faults, the network and the robots of a scenario; `keys`: as in
    `AgentOptions`.
    """
    agents = AgentOptions(
        engine=engine or chosen_engine(),
        plan_delay_us=scenario.plan_delay_us,
        exit_when_done=not scenario.stays,
        keys=keys or {},
    )
    return simulate(
        mission,
        program,
        seed=scenario.seed,
        robots=scenario.robots,
        schedule=scenario.steps,
        network=scenario.network,
        agents=agents,
        timeout_us=scenario.timeout_us,
        speed=scenario.speed,
        keep_log=keep_log,
        record=record,
    )


def _with_engine(setup: Setup, engine: Engine) -> Setup:
    return replace(setup, agents=replace(setup.agents, engine=engine))


def _run(world: World) -> None:
    options = {"loop_factory": lambda: VirtualLoop(world.clock)}
    try:
        with LoopWatchdog(BLOCK_LIMIT_S, _step, _blocked):
            anyio.run(world.main, backend_options=options)
    except Exception as error:
        at_s = world.clock.now_us / 1e6
        text = f"seed {world.setup.seed}, at {at_s:.6f} s: {type(error).__name__}: {error}"
        raise SimulationError(text) from error
    finally:
        if world.recordings is not None:
            world.recordings.close()


def _step() -> int | None:
    """The step of a program's code that runs now."""
    return UserCall.steps if UserCall.stepping is not None else None


def _blocked(frames: list[tuple[str, int]]) -> None:
    """A program blocks for too long: log it at once, and let its work fail when it goes on."""
    call = UserCall.stepping
    if call is not None and not any(map(_is_no_blocking, frames)):
        call.blocked = (
            f"blocked for {BLOCK_LIMIT_S:g} s of real time at {place_of(call.function, frames)}: "
            "await, or run it with anyio.to_thread.run_sync"
        )
        logging.getLogger("mrbt_mesh").warning("%s %s", call.name, call.blocked)


def _is_no_blocking(frame: tuple[str, int]) -> bool:
    """Whether a program blocks for once: it loads a module, or somebody debugs it."""
    file = Path(frame[0])
    return "importlib" in file.name or file.name in ("pdb.py", "bdb.py") or "pydevd" in file.name


def _result(world: World) -> SimulationResult:
    observer, now_us = world.observer, world.clock.now_us
    outlived = world.gave_up and not world.cut_off and world.network.is_reliable_at(now_us)
    inspection = world.inspection
    inspection.ended(outlived, world.timed_out and observer.record.result is None)
    result = observer.result(anybody_lives=bool(world.living()))
    processes = world.robots.processes
    return SimulationResult(
        seed=world.setup.seed,
        result=result,
        summary=run_summary(observer, result, now_us),
        events=world.events,
        effect_log_digest=inspection.effect_log_digest,
        effect_log=list(inspection.effect_log),
        violations=list(inspection.violations),
        checks=dict(inspection.checks),
        done_twice=inspection.done_twice,
        exclusive_done_twice=inspection.exclusive_done_twice,
        stops={r: (p.stop.code, p.stop.reason) for r, p in processes.items() if p.stop},
        fault_counts=dict(world.injector.counts),
        refusals=world.client.refusals(),
        agents={r: p.agent for r, p in processes.items() if p.agent},
        observer=observer,
        duration_us=now_us,
    )
