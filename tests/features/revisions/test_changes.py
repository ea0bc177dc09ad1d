"""What is foretold of a revision is what comes of it."""

from __future__ import annotations

import random

import pytest

from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.features.revisions.changes import is_at_work, revision_changes
from mrbt_mesh.features.revisions.records import AdoptedMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.sim import simulate
from mrbt_mesh.sim.chaos.generate import generate_mission
from mrbt_mesh.sim.chaos.vary import varied
from tests.support.commands import command
from tests.support.effort import seeds

HALFWAY_US = 4_000_000


@pytest.mark.parametrize("seed", seeds(12))
def test_a_dry_run_says_what_stays_and_what_does_not(seed: int) -> None:
    """Of a team in the middle of its work: its facts, with the revision in force."""
    before = generate_mission(seed)
    result = simulate(before.mission, before.program, seed=seed, timeout_us=HALFWAY_US)
    facts = next(iter(result.agents.values())).view.facts
    after = revise(before.mission, varied(before.mission, random.Random(seed)))
    told = revision_changes(facts, after)
    done = {name for name, said in facts.activations.items() if said.has_outcome}

    now = TeamFacts(before.mission, facts.run)
    now.map.merge(facts.map)
    version = Version(Incarnation(9, "n"), 1)
    adopted = make_entry("A1", "mission_adopted/1", version, AdoptedMission(after.digest))
    now.map.merge([command("mission/1", [compile_mission(after), False, False]), adopted])
    assert now.in_force == after
    assert {name for name in done if now.has_outcome(name)} == {*told.kept, *told.kept_failed}
    assert not any(now.has_outcome(name) for name in (*told.begun_again, *told.dropped))
    requests = now.mission.evaluator.evaluate(now).requests
    requested = {request.activation for request in requests}
    for robot, activation, local_task in (*told.going_on, *told.cancelled):
        claim = facts.valid_claim(robot)
        assert claim is not None
        assert is_at_work(claim)
        assert (claim.activation, claim.local_task) == (activation, local_task)
        goes_on = claim.activation in requested and robot in after.robots
        assert goes_on is ((robot, activation, local_task) in told.going_on)
    added = after.global_tasks.keys() - before.mission.global_tasks.keys()
    assert added <= set(told.new_tasks)
