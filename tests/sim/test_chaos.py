"""Chaos: a few hundred seeds on generated missions and on the examples; no invariant breaks.

    MRBT_CHAOS_SEEDS=1000 pytest tests/sim/test_chaos.py      # more of them

`make soak MINUTES=30` goes on with seeds that nobody has tried yet.
"""

from __future__ import annotations

import os
from collections import Counter

import pytest
from runs import EXAMPLES

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.sim.campaign import Source, Verdict, run_seed

SEEDS = int(os.environ.get("MRBT_CHAOS_SEEDS", "200"))
BLOCK = 10
# Slow missions are run faster, and get fewer seeds.
EXAMPLE_SEEDS = {"explore": 1.0, "tool_search": 1.0, "dispense": 0.25, "vehicle_repair": 0.1}


def source(name: str | None) -> Source:
    """The missions of an example, or generated ones."""
    if name is None:
        return Source()
    path = EXAMPLES / name / "mission.yaml"
    return Source(str(path), load_mission(path).program, speed=2.0)


def check(name: str | None, seeds: range) -> Counter[str]:
    """Run seeds; a failure names the seed and the command that shows it. Returns what was checked:
    in how many seeds for each invariant."""
    where = f"examples/{name}/mission.yaml --speed 2" if name else "--generated"
    checked: Counter[str] = Counter()
    for seed in seeds:
        verdict: Verdict = run_seed(source(name), seed)
        command = f"mrbt sim --chaos {where} --seeds {seed}"
        assert not verdict.violations, f"{command}\n" + "\n".join(verdict.violations)
        assert not verdict.exclusive_done_twice, command
        checked.update(verdict.checks.keys())
    return checked


@pytest.mark.timeout(400)  # a few of the missions are large, and repeat until their time is up
@pytest.mark.parametrize("first", range(0, SEEDS, BLOCK))
def test_no_invariant_breaks_on_generated_missions(first: int) -> None:
    checked = check(None, range(first, min(SEEDS, first + BLOCK)))
    # What was never checked was not shown: liveness is demanded of most missions.
    assert checked["I6"] >= BLOCK // 5
    assert {"I1", "I2", "I3", "I4", "I7"} <= checked.keys()


@pytest.mark.parametrize("name", EXAMPLE_SEEDS)
def test_no_invariant_breaks_on_the_examples(name: str) -> None:
    checked = check(name, range(max(1, round(SEEDS // 10 * EXAMPLE_SEEDS[name]))))
    assert checked["I3"]
