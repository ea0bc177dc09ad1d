"""What a robot holds is placed by it; what a dead robot held is picked again."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine
from mrbt_mesh.features.values.plan import OwnStep
from mrbt_mesh.sim import (
    Freeze,
    Kill,
    NetworkKnobs,
    Restart,
    Schedule,
    SimulationResult,
    Thaw,
    Unblock,
    partition,
    simulate,
)
from mrbt_mesh.sim.world.setup import AgentOptions
from tests.support import behaviour
from tests.support.behaviour import ends, mission_of, starts
from tests.support.effort import seeds

S = 1_000_000
DETECTED_S, AGREED_S = 1.0, 1.0
ENGINES = (FASTEST, DEFINITIONS)

# R1 is best at picking, R2 at all else: a plan that minds no conditions has R2 carry and place.
HEAD = """
mission: belonging
local_tasks: {pick: {}, carry: {}, place: {}}
conditions: {holding: {per: robot}, ready: {per: robot}, open: {}}
robot_types: {T: {capabilities: {pick: 1, carry: 1, place: 1}}}
robots:
  R1: {type: T, capabilities: {pick: 5}}
  R2: {type: T, capabilities: {carry: 5, place: 5}}
  R3: T
global_tasks: {pick: {needs: {pick: {}}}, carry: {needs: {carry: {}}}, place: {needs: {place: {}}}}
"""
TREE = "tree: {Sequence: [{Fallback: [{Condition: holding}, pick]}, carry, place]}\n"
SETS = "pick: {sets: {holding: true}}, place: {sets: {holding: false}}"


def run(
    tree: str = TREE,
    schedule: Schedule = (),
    behave: str = SETS,
    expect: str = "success",
    seed: int = 1,
    engine: Engine = FASTEST,
) -> SimulationResult:
    """Simulate; no invariant may break on the way."""
    result = simulate(
        mission_of(HEAD + f"parameters: {{behave: {{{behave}}}}}\n" + tree),
        behaviour.robot,
        seed=seed,
        schedule=schedule,
        network=NetworkKnobs(),
        timeout_us=30 * S,
        agents=AgentOptions(engine=engine),
    )
    assert not result.violations
    assert result.result == expect, result.summary["blocked"]
    return result


def test_who_has_picked_it_up_carries_and_places_it() -> None:
    assert starts(run()) == [("R1", "pick"), ("R1", "carry"), ("R1", "place")]


ITEMS = """
mission: items
local_tasks: {pick: {parameters: [item]}, carry: {parameters: [item]}, place: {parameters: [item]}}
conditions: {holding: {parameters: [item], per: robot}}
robot_types: {T: {capabilities: {pick: 1, carry: 1, place: 1}}}
robots: {R1: {type: T, capabilities: {pick: 5}}, R2: {type: T, capabilities: {place: 5}}, R3: T}
parameters: {behave: {pick: {sets: {"holding({0})": true}}, place: {sets: {"holding({0})": false}}}}
global_tasks:
  pick: {parameters: [item], needs: {pick($item): {}}}
  carry: {parameters: [item], needs: {carry($item): {}}}
  place: {parameters: [item], needs: {place($item): {}}}
tree:
  Parallel:
    memory: while_running
    for_each: {item: [cup, box]}
    do:
      Sequence:
        - Fallback: [{Condition: holding($item)}, pick($item)]
        - carry($item)
        - place($item)
"""


@pytest.mark.parametrize("killed", [None, "R1"])
def test_of_several_items_each_is_placed_by_the_robot_that_holds_it(killed: str | None) -> None:
    schedule: Schedule = [(1_500_000, Kill(killed))] if killed else []
    for engine in ENGINES:
        result = simulate(
            mission_of(ITEMS),
            behaviour.robot,
            seed=1,
            schedule=schedule,
            agents=AgentOptions(engine=engine),
        )
        assert not result.violations
        assert result.result == "success"
        last = {task: robot for robot, task in starts(result)}
        for item in ("cup", "box"):
            assert last[f"pick({item})"] == last[f"place({item})"] != killed


def test_a_condition_of_the_team_does_not_say_whose_it_is() -> None:
    """So the test above can fail."""
    text = HEAD.replace("holding: {per: robot}", "holding: {}") + TREE
    mission = mission_of(text + f"parameters: {{behave: {{{SETS}}}}}\n")
    assert starts(simulate(mission, behaviour.robot, seed=1))[1:] == [
        ("R2", "carry"),
        ("R2", "place"),
    ]


@pytest.mark.parametrize("at_s", [0.5, 1.5, 2.5])
def test_what_a_dead_robot_held_is_picked_again(at_s: float) -> None:
    result = run(schedule=[(round(at_s * S), Kill("R1"))])
    last = starts(result)[-3:]
    assert [task for _, task in last] == ["pick", "carry", "place"]
    assert len({robot for robot, _ in last}) == 1
    assert last[0][0] != "R1"
    assert result.duration_us < (at_s + DETECTED_S + AGREED_S + 4) * S


def test_a_short_absence_takes_nothing_away() -> None:
    """Shorter than it takes until the others agree that what it held is lost."""
    result = run(schedule=[(1_500_000, Freeze("R1")), (2_800_000, Thaw("R1"))])
    assert [task for _, task in starts(result)].count("pick") == 1


@pytest.mark.parametrize("seed", seeds(4))
def test_a_robot_that_comes_back_still_holds_what_it_held(seed: int) -> None:
    """It is too late for what another one has picked, and both hold something."""
    behave = "pick: {sets: {holding: true}}, carry: {seconds: 5}"
    schedule: Schedule = [(1_500_000, Kill("R1")), (6_000_000, Restart("R1"))]
    result = run(behave=behave, schedule=schedule, seed=seed)
    facts = next(iter(result.agents.values())).view.facts
    assert facts.condition("holding@R1")
    assert facts.condition("holding")
    assert starts(result)[0] == ("R1", "pick")


def test_a_robot_that_drops_it_hands_over_to_nobody_else() -> None:
    """`carry` of R1 fails: nobody else holds it, so after a while the task has failed."""
    result = run(behave=SETS + ", carry: {fails: [R1]}", expect="failure")
    assert {robot for robot, _ in starts(result)} == {"R1"}


def test_one_robot_has_to_have_all_that_is_asked_for() -> None:
    tree = (
        "tree: {Sequence: [{Fallback: [{Condition: holding}, pick]}, "
        "{Fallback: [{Sequence: [{Condition: ready}, {Condition: holding}]}, carry]}, place]}\n"
    )
    behave = SETS + ", carry: {sets: {ready: true}}"
    assert starts(run(tree, behave=behave)) == [("R1", "pick"), ("R1", "carry"), ("R1", "place")]


CUT = partition(["R1"], ["R2", "R3"])


@pytest.mark.parametrize(
    "schedule",
    [
        [],
        [(1_500_000, Kill("R1"))],
        [(1_500_000, Kill("R1")), (5_000_000, Restart("R1"))],
        [(1_500_000, CUT), (5_500_000, Unblock(CUT.links))],
    ],
)
def test_each_way_to_plan_gives_the_same_run(schedule: Schedule) -> None:
    results = [run(schedule=schedule, engine=engine) for engine in ENGINES]
    assert len({result.effect_log_digest for result in results}) == 1
    assert ends(results[0], "place")


def test_the_checkers_notice_who_places_what_another_one_holds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(OwnStep, "eligible", lambda *_: None)
    mission = mission_of(HEAD + f"parameters: {{behave: {{{SETS}}}}}\n" + TREE)
    violations = simulate(mission, behaviour.robot, seed=1).violations
    assert violations
    assert "I4" in violations[0]
    assert "R2 starts carry, but holding does not hold for it" in violations[0]
