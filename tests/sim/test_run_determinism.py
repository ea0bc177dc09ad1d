"""One seed, one run: effect for effect, also in another process under another hash seed."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mrbt_mesh.sim import Kill, LinkKnobs, NetworkKnobs, Restart, SimulationResult
from tests.support.paths import EXAMPLES
from tests.support.runs import Run

ROUGH = NetworkKnobs(LinkKnobs(jitter_us=3_000, loss_permille=100, duplicate_permille=50))
SCHEDULE = [(1_200_000, Kill("A1")), (2_500_000, Kill("C2")), (3_500_000, Restart("C2"))]

PROGRAM = """
import sys
from pathlib import Path
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Kill, LinkKnobs, NetworkKnobs, Restart, simulate
mission = load_mission(Path(sys.argv[1]))
network = NetworkKnobs(LinkKnobs(jitter_us=3_000, loss_permille=100, duplicate_permille=50))
schedule = [(1_200_000, Kill("A1")), (2_500_000, Kill("C2")), (3_500_000, Restart("C2"))]
result = simulate(
    mission, load_program(mission.program), seed=11, schedule=schedule, network=network, speed=4.0
)
print(result.effect_log_digest)
"""


def faulty(run: Run, seed: int, keep_log: bool = False) -> SimulationResult:
    return run(
        "vehicle_repair", seed, schedule=SCHEDULE, network=ROUGH, speed=4.0, keep_log=keep_log
    )


def test_the_same_seed_gives_the_same_run(run: Run) -> None:
    first, second = faulty(run, 11, keep_log=True), faulty(run, 11, keep_log=True)
    assert first.effect_log == second.effect_log
    assert first.effect_log_digest == second.effect_log_digest
    assert first.events == second.events
    assert first.summary == second.summary


@pytest.mark.slow
def test_keeping_the_log_changes_nothing_and_another_seed_does(run: Run) -> None:
    kept = faulty(run, 11, keep_log=True)
    assert faulty(run, 11).effect_log_digest == kept.effect_log_digest
    assert faulty(run, 12).effect_log_digest != kept.effect_log_digest


@pytest.mark.parametrize("hash_seed", ["1", "4711"])
def test_another_process_under_another_hash_seed_gives_the_same_run(
    run: Run, hash_seed: str
) -> None:
    expected = faulty(run, 11).effect_log_digest
    found = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(EXAMPLES / "vehicle_repair" / "mission.yaml")],
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == expected
