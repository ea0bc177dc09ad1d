"""Every deliberate bug is caught by the chaos run, within the seeds that are named here.

Without it the same seeds are clean: test_chaos.py runs them all.
"""

from __future__ import annotations

import pytest
from mutations import MUTATIONS

from mrbt_mesh.sim.campaign import Source, run_seed

SEEDS = {
    "join_keeps_older": (1, 4),
    "unsorted_workers": (1, 4),
    "no_pins": (3, 10),
    "revision_not_bumped": (4, 12),
    "outcomes_dropped_at_restart": (1, 4),
    "digest_ignores_conditions": (22,),
    "starts_without_agreement": (12, 14),
    "any_optimum": (1, 30),
    "told_before_synced": (0, 1),
    "prunes_what_is_current": (2, 3),
}


@pytest.mark.parametrize("name", SEEDS)
def test_a_deliberate_bug_is_caught(name: str) -> None:
    for seed in SEEDS[name]:
        with MUTATIONS[name]():
            if run_seed(Source(), seed).violations:
                return
    pytest.fail(f"{name} broke no invariant in seeds {SEEDS[name]}")


def test_no_mutation_is_left_out() -> None:
    assert MUTATIONS.keys() == SEEDS.keys()
