"""Every deliberate bug breaks its invariant in a chaos run, within the seeds that are named here.

Without it the same seeds are clean: test_chaos.py runs them all.
"""

from __future__ import annotations

import pytest

from mrbt_mesh.core.engine import DEFINITIONS
from mrbt_mesh.runtime.solver_loader import chosen_engine
from mrbt_mesh.sim.chaos.campaign import Source, run_seed
from tests.support.effort import at_size
from tests.support.mutations import MUTATIONS

CAUGHT = {
    "join_keeps_older": ("I9", (0, 1)),
    "every_mission_ends": ("I6", (115, 167)),
    "unsorted_workers": ("I1", (0, 1)),
    "no_pins": ("I4", (38, 19)),
    "changes_not_counted": ("I2", (4, 12)),
    "outcomes_dropped_at_restart": ("I9", (1, 4)),
    "no_relays": ("I2", (6, 10)),
    "digest_ignores_conditions": ("I2", (44, 46)),
    "stale_claims_stay_valid": ("I6", (42, 46)),
    "no_repair": ("I2", (4, 34)),
    "starts_without_agreement": ("I4", (43, 75)),
    "any_optimum": ("I7", (41, 42)),
    "bids_not_awaited": ("I7", (0, 19)),
    "told_before_synced": ("I9", (0, 1)),
    "promises_before_synced": ("I5", (45, 69)),
    "prunes_what_is_current": ("I3", (3, 2)),
    "exclusive_without_majority": ("I5", (41, 33)),
    "grants_not_synced": ("I9", (50, 57)),
    "rounds_are_mixed": ("I4", (89, 240)),
    "garbled_commands_pause": ("I8", (0, 63)),
    "losses_are_overlooked": ("I7", (0, 1)),
    "guards_are_counted_one_by_one": ("I3", (34, 88)),
    "compound_conditions_guard_nothing": ("I3", (23, 42)),
    "per_robot_conditions_are_anybodys": ("I4", (183, 257)),
    "the_dead_are_waited_for": ("I6", (87, 89)),
    "the_dead_count_as_assigned": ("I6", (259,)),
    "ended_jobs_are_forgotten": ("I10", (26, 102)),
    "ended_jobs_go_on": ("I10", (6, 7)),
    "wrong_clocks_are_believed": ("I10", (12, 26)),
    "revisions_are_not_waited_for": ("I11", (28, 48)),
    "those_without_contact_have_stopped": ("I12", (544, 690)),
    "assigned_without_constraints": ("I13", (18, 73)),
    "arguments_are_read_anew": ("I4", (30, 57)),
    "schedules_by_arrival": ("I1", (198, 210)),
    "schedules_against_the_tree": ("I6", (86, 39)),
}


# Bugs in what only makes plans faster.
OF_QUICK_PLANS = {"losses_are_overlooked"}


@pytest.mark.parametrize("name", at_size(quick=sorted(CAUGHT)[::4], gate=sorted(CAUGHT)))
def test_a_deliberate_bug_is_caught(name: str) -> None:
    invariant, seeds = CAUGHT[name]
    is_used = name not in OF_QUICK_PLANS or chosen_engine() is not DEFINITIONS
    for seed in seeds:
        with MUTATIONS[name]():
            found = run_seed(Source(), seed).invariants
        if not is_used:
            assert not found
        elif invariant in found:
            return
    assert not is_used, f"{name} did not break {invariant} in seeds {seeds}"


# Chaos seldom stalls a partner for longer than the usual bound: test_run_coalitions.py does.
# It seldom holds jobs that have begun: test_run_jobs.py does. Its robots wait for no others at the
# start: test_agent_scripts.py has one that hears nobody.
CAUGHT_ELSEWHERE = {"held_jobs_go_on", "partners_may_be_late", "alone_begins_at_once"}


def test_no_mutation_is_left_out() -> None:
    assert MUTATIONS.keys() == CAUGHT.keys() | CAUGHT_ELSEWHERE


def test_every_invariant_is_broken_by_one() -> None:
    assert {invariant for invariant, _ in CAUGHT.values()} == {f"I{i}" for i in range(1, 14)}
