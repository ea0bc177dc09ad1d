"""When steps are due, on sights made by hand and on an observer fed by the simulator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.facts.records import Claim, Phase
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.drills.model import RoleModel, StepModel
from mrbt_mesh.drills.triggers import FaultLog, Schedule, Snapshot, Takeover, chosen, holds
from mrbt_mesh.observer.task_log import TaskState
from mrbt_mesh.sim import Kill, simulate
from tests.support.runs import example

S = 1_000_000


def claim(local_task: str, phase: Phase = Phase.RUNNING, global_task: str = "fix") -> Claim:
    return Claim("x", global_task, local_task, phase, 1)


SNAPSHOT = Snapshot(
    now_us=10 * S,
    started_us=2 * S,
    statuses={"fix": TaskState.RUNNING, "open": TaskState.SUCCESS},
    claims={"A1": claim("weld(2)"), "B1": claim("weld(3)", Phase.CLAIMED)},
    claimed=(
        (7 * S, "B1", claim("cut", Phase.CLAIMED)),
        (9 * S, "B1", claim("saw", Phase.CLAIMED)),
    ),
    done=frozenset({("A2", "lift")}),
    states={"A1": State.ALIVE, "A2": State.DEAD, "B1": State.SUSPECT},
    conditions={"wet": True},
    takeovers=(Takeover("A2", "weld(2)", "A1", 9 * S), Takeover("C1", "lift", "B1", 5 * S)),
    blocked={"close": "blocked: lift needs 2, 1 alive"},
)


def step(**keys: Any) -> StepModel:
    return StepModel.model_validate(keys)


def when(**keys: Any) -> Any:
    return step(when=keys, kill="A1").when


@pytest.mark.parametrize(
    ("trigger", "expected"),
    [
        ({"global_task": "fix"}, True),
        ({"global_task": "fix", "status": "success"}, False),
        ({"global_task": "open", "status": "success"}, True),
        ({"global_task": "other", "status": "idle"}, True),
        ({"local_task": "weld(2)"}, True),
        ({"local_task": "weld"}, True),
        ({"local_task": "weld(3)"}, False),
        ({"local_task": "weld(3)", "phase": "claimed"}, True),
        ({"local_task": "weld(2)", "robot": "B1"}, False),
        ({"local_task": "saw", "phase": "claimed"}, True),
        ({"local_task": "cut", "phase": "claimed"}, False),
        ({"local_task": "lift", "phase": "done"}, True),
        ({"local_task": "lift", "phase": "done", "robot": "A1"}, False),
        ({"robot": "A2", "state": "dead"}, True),
        ({"robot": ["A1", "A2"], "state": "dead"}, False),
        ({"robot": {"killed": None}, "state": "dead"}, True),
        ({"robot": {"stopped": None}, "state": "dead"}, False),
        ({"robot": "Z9", "state": "dead"}, False),
        ({"condition": "wet"}, True),
        ({"condition": "wet", "is": False}, False),
        ({"takeover": "weld(2)"}, True),
        ({"takeover": "weld"}, True),
        ({"takeover": "lift"}, False),
        ({"blocked": "close"}, True),
        ({"blocked": "close", "reason": "lift needs 2"}, True),
        ({"blocked": "close", "reason": "in doubt"}, False),
        ({"blocked": "fix"}, False),
    ],
)
def test_triggers(trigger: dict[str, Any], expected: bool) -> None:
    fault_log = FaultLog()
    fault_log.killed.append("A2")
    assert holds(when(**trigger), SNAPSHOT, fault_log, since_us=8 * S) is expected


def test_roles_are_robots_of_the_moment() -> None:
    fault_log = FaultLog()
    fault_log.killed += ["B2", "A2"]
    fault_log.stopped.append("C1")

    def role(**keys: Any) -> list[str]:
        return chosen(RoleModel.model_validate(keys), SNAPSHOT, fault_log)

    assert chosen("A1", SNAPSHOT, fault_log) == ["A1"]
    assert chosen(["B1", "A1"], SNAPSHOT, fault_log) == ["B1", "A1"]
    assert role(performing="fix") == ["A1"], "B1 has only claimed its part"
    assert role(performing="weld(3)") == ["B1"]
    assert role(performing="weld") == ["A1"]
    assert role(performing="lift") == []
    assert role(replacement=None) == ["A1"]
    assert role(killed=None) == ["B2", "A2"]
    assert role(stopped=None) == ["C1"]
    fault_log.lives("B2")
    assert role(killed=None) == ["A2"]


def at(now_s: float, **changes: Any) -> Snapshot:
    return replace(Snapshot(0, started_us=2 * S), now_us=round(now_s * S), **changes)


def test_at_counts_from_the_start_and_after_from_the_step_before() -> None:
    schedule = Schedule([step(at=1.5, kill="A1"), step(after=0.5, restart="A1")])
    fault_log = FaultLog()
    assert schedule.due(replace(at(9), started_us=None), fault_log) is None
    assert schedule.due(at(3.4), fault_log) is None
    assert schedule.due_us(at(3.4), fault_log) == 3.5 * S
    first = schedule.due(at(3.6), fault_log)
    assert first is schedule.steps[0]
    schedule.carried_out(round(3.6 * S))
    assert schedule.due(at(4.0), fault_log) is None
    assert schedule.due(at(4.1), fault_log) is schedule.steps[1]
    schedule.carried_out(round(4.1 * S))
    assert schedule.is_over
    assert schedule.due(at(99), fault_log) is None


def test_a_trigger_is_latched_and_after_counts_from_it() -> None:
    schedule = Schedule([step(when={"blocked": "fix"}, after=1, kill="A1")])
    fault_log = FaultLog()
    assert schedule.due(at(3), fault_log) is None
    assert schedule.due(at(4, blocked={"fix": ""}), fault_log) is None
    assert schedule.due(at(4.9), fault_log) is None
    assert schedule.due(at(5.0), fault_log) is schedule.steps[0]


def test_steps_keep_their_order_although_a_later_trigger_holds_first() -> None:
    steps = [step(when={"blocked": "fix"}, kill="A1"), step(at=0, kill="B1")]
    schedule = Schedule(steps)
    fault_log = FaultLog()
    assert schedule.due(at(5), fault_log) is None
    assert schedule.due(at(6, blocked={"fix": ""}), fault_log) is steps[0]
    schedule.carried_out(6 * S)
    assert schedule.due(at(6), fault_log) is steps[1]


def test_a_takeover_counts_from_the_beginning_of_the_step_before() -> None:
    steps = [step(at=0, kill="A1"), step(when={"takeover": "weld"}, kill={"replacement": None})]
    schedule = Schedule(steps)
    fault_log = FaultLog()
    schedule.carried_out(5 * S)
    old = Takeover("A1", "weld", "B1", round(4.9 * S))
    assert schedule.due(at(6, takeovers=(old,)), fault_log) is None
    new = Takeover("A1", "weld", "B2", round(5.02 * S))
    assert schedule.due(at(6, takeovers=(old, new)), fault_log) is steps[1]


def test_a_role_that_nobody_plays_yet_is_waited_for() -> None:
    steps = [
        step(at=0, kill={"performing": "fix"}),
        step(after=0, block={"from": {"killed": None}}),
    ]
    schedule = Schedule(steps)
    fault_log = FaultLog()
    assert schedule.due(at(3), fault_log) is None
    assert schedule.due(at(4, claims={"A1": claim("weld(2)")}), fault_log) is steps[0]
    schedule.carried_out(4 * S)
    assert schedule.due(at(5), fault_log) is None
    fault_log.killed.append("A1")
    assert schedule.due(at(6), fault_log) is steps[1]


@pytest.mark.parametrize(
    ("given", "held"),
    [
        ({"when": {"local_task": "weld(2)"}, "kill": "A1"}, {"weld(2)"}),
        ({"when": {"local_task": "weld", "phase": "claimed"}, "kill": "A1"}, {"weld"}),
        ({"when": {"local_task": "weld(2)", "phase": "done"}, "kill": "A1"}, set()),
        ({"when": {"global_task": "fix"}, "kill": "A1"}, {"fix"}),
        ({"when": {"global_task": "fix", "status": "success"}, "kill": "A1"}, set()),
        ({"when": {"takeover": "weld(2)"}, "kill": {"replacement": None}}, {"weld(2)"}),
        ({"after": 0.5, "leave": {"performing": "weld(2)"}}, {"weld(2)"}),
        ({"when": {"condition": "wet"}, "kill": {"performing": "weld"}}, set()),
        ({"at": 1, "kill": "A1"}, set()),
    ],
)
def test_what_a_step_means_to_meet_running_is_held_until_then(
    given: dict[str, Any], held: set[str]
) -> None:
    schedule = Schedule([step(**given)])
    assert schedule.held() == held
    schedule.carried_out(0)
    assert schedule.held() == set()


def test_the_sight_of_an_observer_in_the_middle_of_a_run() -> None:
    mission, program = example("vehicle_repair")
    kill = [(13 * S, Kill("A1"))]
    seen = simulate(mission, program, seed=3, schedule=kill, timeout_us=16 * S)
    snapshot = Snapshot.of(seen.observer, ["broken(2)", "nominal"], 16 * S)
    assert snapshot.started_us is not None
    assert snapshot.statuses["remove_cover"] is TaskState.SUCCESS
    assert snapshot.conditions == {"broken(2)": True, "nominal": False}
    assert snapshot.states["A1"] is State.DEAD
    assert "A1" not in snapshot.claims
    assert all(robot in seen.observer.robots() for robot in snapshot.claims)
    assert {local_task for _, local_task in snapshot.done} >= {"use_screwdriver", "do_diagnosis(1)"}
    (takeover,) = snapshot.takeovers
    assert takeover.robot == "A1"
    assert takeover.local_task.startswith("replace_hw")
    assert takeover.replacement in ("A2", "B1", "B2")
    assert not snapshot.blocked
