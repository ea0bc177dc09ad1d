"""The run that the paper describes: all goes well until a robot of type A dies at the wires."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path

from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.drills.physical import Span, of, spans
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.run_record import RunRecord
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Fault, Kill, SimulationResult, simulate
from mrbt_mesh.sim.run import DEFAULT_TIMEOUT_US

ROOT = Path(__file__).resolve().parents[1]
MISSION = ROOT / "examples" / "vehicle_repair" / "mission.yaml"
SEED = 1


class AccountError(RuntimeError):
    """The run does not go as the paper tells; the message names the seed."""


@dataclass(frozen=True)
class Account:
    """One run. `spans` are what its robots physically did, `fault` what befell which one when."""

    mission: Mission
    seed: int
    fault: tuple[int, Kill] | None
    result: SimulationResult
    spans: tuple[Span, ...]

    @property
    def record(self) -> RunRecord:
        return self.result.observer.record


def load() -> Mission:
    """The mission of the example; raises MissionFileError."""
    return load_mission(MISSION)


def run(
    mission: Mission,
    seed: int,
    *schedule: tuple[int, Fault],
    timeout_us: int = DEFAULT_TIMEOUT_US,
) -> Account:
    """The mission in virtual time; raises SimulationError, AccountError if an invariant broke."""
    assert mission.program is not None
    program = load_program(mission.program)
    result = simulate(mission, program, seed=seed, schedule=schedule, timeout_us=timeout_us)
    if result.violations:
        raise AccountError(f"seed {seed}: {'; '.join(result.violations)}")
    record = result.observer.record
    deaths = {record.robots[f.robot]["pid"]: f.at_us / 1e6 for f in record.major}
    kills = [(at_us, fault) for at_us, fault in schedule if isinstance(fault, Kill)]
    physical = tuple(spans(result.events, deaths))
    return Account(mission, seed, kills[0] if kills else None, result, physical)


@functools.cache
def tell(seed: int = SEED) -> Account:
    """The paper's run.

    The A that has put new hardware into the last broken part dies when it has just claimed the
    wires of that part. When that is, a run without a fault from the same seed tells: up to the
    death both are the same.
    """
    mission = load()
    calm = run(mission, seed)
    last = max(of(calm.spans, "replace_hw"), key=lambda span: span.part)
    wires = f"replace_wires({last.part})"
    for at_us, robot, claim in calm.record.claims:
        if (robot, claim.local_task) == (last.robot, wires):
            return run(mission, seed, (at_us + 1, Kill(robot)))
    raise AccountError(f"seed {seed}: {last.robot} does not claim {wires} when its hardware is in")
