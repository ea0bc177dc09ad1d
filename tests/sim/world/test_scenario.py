"""Scenarios as JSON: what is written is read again, and what is wrong is said."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest

from mrbt_mesh.features.exclusive.fields import in_doubt_policy, is_simultaneous
from mrbt_mesh.sim.chaos.draw import ChaosKnobs, chaos, draw_knobs
from mrbt_mesh.sim.chaos.generate import generate_mission
from mrbt_mesh.sim.checkers.progress import is_endless
from mrbt_mesh.sim.world.faults import Block, Disturb, Heal, Kill, LinkKnobs, Replay
from mrbt_mesh.sim.world.scenario import KINDS, Scenario, ScenarioError, dump, scenario_from_json
from tests.support.runs import example

SECOND_US = 1_000_000


def drawn(seed: int) -> Scenario:
    mission, _ = example("vehicle_repair")
    return chaos(mission, seed, draw_knobs(seed, len(mission.robots)))


@pytest.mark.parametrize("seed", range(40))
def test_a_scenario_survives_being_written_and_read(seed: int) -> None:
    scenario = drawn(seed)
    assert scenario_from_json(json.loads(dump(scenario))) == scenario


def test_a_schedule_file_has_a_line_per_fault() -> None:
    scenario = drawn(3)
    lines = [line for line in dump(scenario, mission="m.yaml").splitlines() if '"fault"' in line]
    assert len(lines) == len(scenario.steps)
    assert json.loads(dump(scenario, mission="m.yaml"))["mission"] == "m.yaml"


def test_sets_of_links_and_nested_knobs_are_plain_data() -> None:
    steps = (
        (5, Block(frozenset({("A", "B"), ("B", "A")}))),
        (7, Disturb(LinkKnobs(loss_permille=300), frozenset({("A", "B")}))),
        (8, Replay("A", "B", 3)),
        (9, Heal(("A",), frozenset({("B", "A")}))),
    )
    scenario = Scenario(1, ("A", "B"), steps, 9, 20)
    data = scenario.to_json()["steps"]
    assert data[0] == [5, {"fault": "Block", "links": [["A", "B"], ["B", "A"]]}]
    assert data[1][1]["link"] == {"loss_permille": 300}
    assert scenario_from_json(json.loads(dump(scenario))) == scenario


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"steps": None}, "schedule: steps: a list expected"),
        ({"steps": [[1]]}, "steps.0: a list of 2 expected"),
        ({"steps": [[1, {"fault": "Explode"}]]}, "no fault 'Explode'; there is Kill"),
        ({"steps": [[1, {"fault": ["Kill"]}]]}, "steps.0.1: no fault ['Kill']; there is Kill"),
        ({"steps": [[-1, {"fault": "Kill", "robot": "A"}]]}, "steps.0.0: a time from 0 us on"),
        ({"steps": [[1.5, {"fault": "Kill", "robot": "A"}]]}, "steps.0.0: a whole number"),
        ({"steps": [[1, {"fault": "Kill"}]]}, "steps.0.1: Kill: 'robot' is missing"),
        ({"steps": [[1, {"fault": "Kill", "robot": 7}]]}, "robot: a text expected, not 7"),
        (
            {"steps": [[1, {"fault": "Kill", "robot": "A", "x": 1}]]},
            "Kill.x: nothing of this name (only robot)",
        ),
        ({"steps": [[1, {"fault": "Block", "links": [["A"]]}]]}, "links.0: a list of 2 expected"),
        ({"link": {"loss_permille": 2000}}, "a chance is from 0 to 1000 permille"),
        ({"seed": "one"}, "schedule: seed: a whole number expected, not 'one'"),
        ({"speed": True}, "schedule: speed"),
        ({"speed": 10**400}, "schedule: speed: a number expected, not 1000"),
        ({"speed": "1"}, "speed: a number expected, not '1'"),
        ({"colour": 1}, "colour: nothing of this name (only seed, robots, steps,"),
    ],
)
def test_what_is_wrong_is_said(change: dict[str, Any], message: str) -> None:
    data = json.loads(dump(drawn(1))) | change
    with pytest.raises(ScenarioError) as caught:
        scenario_from_json(data)
    assert message in str(caught.value)


def test_no_object_at_all() -> None:
    with pytest.raises(ScenarioError, match="schedule: an object expected"):
        scenario_from_json([])


def test_routers_cannot_die_where_there_are_none() -> None:
    data = drawn(5).to_json()
    data["steps"].append([1, {"fault": "EndRouter", "router": "r1"}])
    with pytest.raises(ScenarioError, match="there are no routers in a schedule"):
        scenario_from_json(data)


def test_the_same_seed_gives_the_same_chaos_and_another_seed_another() -> None:
    assert drawn(5) == drawn(5)
    assert drawn(5).steps != drawn(6).steps


def test_all_kinds_of_fault_are_drawn() -> None:
    drawn_kinds = {type(fault).__name__ for seed in range(300) for _, fault in drawn(seed).steps}
    # An Unblock, Settle or Thaw may come, a Restore follows a Lose. To the others, a KillAfter is
    # a Kill; it is for experiments. Routers die in worlds that have some: see test_routers. Wall
    # clocks matter in missions with jobs, and generated missions are revised. A pause may break an
    # invariant for a moment: see test_run_pauses. Operators do more than words to one robot can.
    others = {"KillAfter", "EndRouter", "StartRouter", "SetWallClock", "Revise", "Pause", "Command"}
    assert drawn_kinds == KINDS.keys() - others


@pytest.mark.parametrize("seed", range(60))
def test_chaos_ends_with_the_healing_and_keeps_within_its_knobs(seed: int) -> None:
    mission, _ = example("vehicle_repair")
    knobs = draw_knobs(seed, len(mission.robots))
    scenario = chaos(mission, seed, knobs)
    times = [at_us for at_us, _ in scenario.steps]
    assert times == sorted(times)
    assert scenario.robots
    assert isinstance(scenario.steps[-1][1], Heal)
    assert scenario.heal_us == times[-1] == knobs.chaos_us < scenario.timeout_us
    if not knobs.kills and not knobs.lost_disks and not knobs.team_crashes:
        assert not any(isinstance(fault, Kill) for _, fault in scenario.steps)


def test_no_more_robots_are_down_at_once_than_allowed() -> None:
    mission, _ = example("vehicle_repair")
    none = dict.fromkeys((f.name for f in dataclasses.fields(ChaosKnobs)), 0.0)
    times: dict[str, Any] = {"chaos_us": 9 * SECOND_US, "quiet_us": SECOND_US}
    more: dict[str, Any] = {**times, "longest_us": 5 * SECOND_US, "max_down": 2, "returns": 1.0}
    knobs = ChaosKnobs(**{**none, **more, "kills": 9.0})
    for seed in range(50):
        down = set()
        for _, fault in chaos(mission, seed, knobs).steps:
            if isinstance(fault, Kill):
                down.add(fault.robot)
            else:
                down.discard(getattr(fault, "robot", ""))
            assert len(down) <= 2, seed


def test_swarm_testing_turns_half_of_the_kinds_off() -> None:
    kills = [draw_knobs(seed, 6).kills for seed in range(200)]
    assert 60 < kills.count(0.0) < 140
    assert max(kills) > 2


@pytest.mark.parametrize("seed", range(30))
def test_generated_missions_are_the_same_for_a_seed_and_can_be_read_from_their_file(
    seed: int,
) -> None:
    generated = generate_mission(seed)
    assert generated.text == generate_mission(seed).text
    assert 2 <= len(generated.mission.robots) <= 16
    assert generated.mission.global_tasks


@pytest.mark.slow
def test_generated_missions_have_everything_in_them() -> None:
    missions = [generate_mission(seed).mission for seed in range(150)]
    kinds = {str(node.kind) for mission in missions for node in mission.tree.nodes}
    tasks = [task for mission in missions for task in mission.global_tasks.values()]
    assert kinds >= {"Sequence", "Fallback", "Parallel", "Condition", "Inverter", "Timeout"}
    assert kinds >= {"RetryUntilSuccessful", "Repeat", "ForceSuccess", "ForceFailure"}
    assert kinds >= {"KeepRunningUntilFailure"}
    assert any(task.preemptive for task in tasks)
    assert {str(task.failure) for task in tasks} == {"first", "paper", "resilient"}
    assert any(task.blocked_fail_after_us for task in tasks)
    assert any(is_simultaneous(task) for task in tasks)
    assert {str(in_doubt_policy(task)) for task in tasks if task.at_most_once} == {
        "hold",
        "fail",
        "retry",
    }
    assert any(len(task.needs) > 1 for task in tasks)
    assert any(task.failure_after_us for task in tasks)
    # Guards of several conditions, robots that always fail, capabilities lost before they are used.
    assert sum(bool(mission.evaluator.expressions) for mission in missions) > 10
    behaviours = [mission.parameters["tasks"].values() for mission in missions]
    assert any("fails_on" in each for found in behaviours for each in found)
    assert any(mission.parameters.get("losses") for mission in missions)
    assert 0 < sum(map(is_endless, missions)) < 75
