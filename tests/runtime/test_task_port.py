"""What robots' programs say: positions, and entries of the blackboard."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from mrbt_mesh.core.agent.inputs import ConditionSet
from mrbt_mesh.core.membership.wire import Position
from mrbt_mesh.core.mission.conditions import ConditionType
from mrbt_mesh.features.values.blackboard import ValueType
from mrbt_mesh.features.values.traits import Traits
from mrbt_mesh.runtime.task_port import AgentPort, milli_position
from mrbt_mesh.views.model.team_view import TeamView
from tests.support.action_host import Host
from tests.support.build import action, make_mission
from tests.support.runs import run_example

ENTRIES = (
    ConditionType("open"),
    ConditionType("found", traits=Traits(values=ValueType(choices=("red", "blue")), per_job=True)),
    ConditionType("level", traits=Traits(values=ValueType(low=0, high=1_000, decimals=1))),
)


def port(host: Host, ticket: int | None = 7, job: str = "j1") -> AgentPort:
    mission = replace(make_mission(action("a")), conditions={each.name: each for each in ENTRIES})
    return AgentPort(host, mission, ticket, lambda: None, job)


def test_values_go_with_the_outcome_or_at_once() -> None:
    host = Host()
    of_task = port(host)
    of_task.set_value("level", 12.34, at_once=False)
    of_task.set_conditions({"found": "red", "open": True})
    assert of_task.conditions == {"level": 123, "found": "red", "open": True}
    assert (of_task.read_value("level"), of_task.read_value("found")) == (12.3, "red")
    of_task.set_value("found", None, at_once=True)
    port(host, ticket=None).set_value("level", 5, at_once=False)
    assert host.said == [ConditionSet("found", None, "j1"), ConditionSet("level", 50, "j1")]
    host.values["level", "j1"] = 501
    assert port(host).read_value("level") == 50.1
    assert port(host).read_value("found") is None


@pytest.mark.parametrize(
    ("name", "value", "job", "message"),
    [
        (
            "fund",
            "red",
            "j1",
            r"'fund' is not an entry of the mission's blackboard \(found, level\)",
        ),
        ("open", True, "j1", "'open' is not an entry"),
        (3, "red", "j1", "3 is not an entry"),
        ("found", "red", "", "each job has its own found, and this is not a task of a job"),
        ("found", "green", "j1", "found is not set: it is one of red, blue, not 'green'"),
        ("level", 100.1, "j1", "level is not set: it is a number with 1 decimals from 0.0 to 100"),
    ],
)
def test_values_that_no_program_can_set(name: Any, value: Any, job: str, message: str) -> None:
    of_task = port(Host(), job=job)
    with pytest.raises(ValueError, match=message):
        of_task.set_value(name, value, at_once=False)
    with pytest.raises(ValueError, match=r"'level' is a blackboard entry, .* use set_value"):
        of_task.set_condition("level", True, at_once=False)
    assert of_task.conditions == {}


def test_in_thousandths_and_within_one_turn() -> None:
    assert milli_position(1.5, -2, None) == Position(1_500, -2_000)
    assert milli_position(0, 0, math.pi / 2) == Position(0, 0, 1_571)
    assert milli_position(0, 0, 5 * math.pi / 2) == Position(0, 0, 1_571)


@pytest.mark.parametrize("number", [math.nan, math.inf, 1e6 + 1, "1", True, None])
def test_what_is_no_position_is_the_programs_fault(number: Any) -> None:
    with pytest.raises(ValueError, match="a position consists of numbers"):
        milli_position(number, 0, None)


def test_couriers_are_seen_where_they_have_delivered() -> None:
    """The last thing that each courier said stands at a destination, or at its station."""
    result = run_example("couriers", 1)
    view = TeamView(result.observer)
    view.update(result.duration_us)
    items = view.changes.since(0)
    parameters = result.observer.mission.parameters
    ends = [tuple(map(float, to)) for _, to in parameters["parcels"].values()]
    ends += [tuple(map(float, at)) for at in parameters["stations"].values()]
    positions = {k: (v["x"], v["y"]) for k, v in items.items() if k.startswith("position/")}
    assert len(positions) == 4
    assert set(positions.values()) <= set(ends)
    assert {items[f"place/{name}"] for name in parameters["parcels"]} == {"good"}
