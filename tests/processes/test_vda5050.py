"""A team whose robots are AGVs that others have written, over a real broker: what is driven is what
the vehicles say themselves. `make test-vda5050` gets what this needs.
"""

from __future__ import annotations

import logging
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.adapters.vda5050.layout_file import BROKER_VARIABLE
from tests.support.paths import ROOT, mission_file
from tests.support.team import Team
from tests.support.vda5050.plant import VEHICLES, Plant, Said, lacking, stop_of

pytest.importorskip("aiomqtt", reason="the extra vda5050 is not installed: make test-vda5050")
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(lacking()), reason=lacking())]

# How long it took: `pytest --log-cli-level=info`.
LOG = logging.getLogger(__name__)
WAREHOUSE = mission_file("warehouse")
COUNTS = [["R1"], ["R2"], ["R3"], ["R4"], ["R5"], ["R6"]]
DELIVERIES = [["R1", "D1"], ["R2", "D2"], ["R4", "D3"], ["R5", "D1"]]
WORK = COUNTS + DELIVERIES


@pytest.fixture
def plant(tmp_path: Path) -> Iterator[Plant]:
    """A broker without vehicles."""
    folder = tmp_path / "plant"
    folder.mkdir()
    with Plant(folder) as found:
        yield found


def bring_in(plant: Plant, *robots: str) -> None:
    for robot in robots:
        plant.start_vehicle(robot)
    for robot in robots:
        plant.wait_for(lambda said, r=robot: (said.robot, said.topic) == (r, "state"), robot)


def begin(team: Team, plant: Plant, *options: str) -> None:
    team.environment[BROKER_VARIABLE] = f"127.0.0.1:{plant.port}"
    program = str(ROOT / "agents/agvs.py")
    team.up(WAREHOUSE, "--program", program, *options)


def finished(plant: Plant) -> list[list[str]]:
    """The stops of all orders that their vehicles have carried out to the end."""
    done = []
    for order in plant.orders():
        wanted = {a["actionId"] for n in order.body["nodes"] for a in n["actions"]}
        if any(
            _has_finished(said, order.body["orderId"], wanted) for said in plant.states(order.robot)
        ):
            done.append(stop_of(order.body))
    return done


def _has_finished(said: Said, order_id: str, wanted: set[str]) -> bool:
    state = said.body
    ended = {a["actionId"] for a in state["actionStates"] if a["actionStatus"] == "FINISHED"}
    return state["orderId"] == order_id and wanted <= ended


def is_driving(order: Said) -> Callable[[Said], bool]:
    return lambda said: (
        said.topic == "state"
        and said.robot == order.robot
        and said.body["orderId"] == order.body["orderId"]
        and said.body["driving"] is True
    )


def driving_delivery(plant: Plant) -> Said:
    """The order of the first delivery, once its vehicle drives."""
    order = plant.wait_for(
        lambda said: said.topic == "order" and stop_of(said.body) in DELIVERIES, "a delivery"
    )
    plant.wait_for(is_driving(order), "it drives")
    return order


def was_cancelled(order: Said) -> Callable[[Said], bool]:
    """Whether a vehicle says of this order that it has ended before its end."""

    def holds(said: Said) -> bool:
        if said.topic != "state" or said.robot != order.robot:
            return False
        state: dict[str, Any] = said.body
        failed = any(
            a["actionId"].startswith(order.body["orderId"]) and a["actionStatus"] == "FAILED"
            for a in state["actionStates"]
        )
        return state["orderId"] == order.body["orderId"] and failed and not state["nodeStates"]

    return holds


def test_six_agvs_of_two_kinds_do_the_shift(team: Team, plant: Plant) -> None:
    bring_in(plant, *VEHICLES)
    begin(team, plant)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    # Each thing was done once, and by nobody else besides.
    assert sorted(stop_of(order.body) for order in plant.orders()) == sorted(WORK)
    assert sorted(finished(plant)) == sorted(WORK)
    # Bids were made from where vehicles are: the nearest ones go.
    first = {order.robot: stop_of(order.body) for order in plant.orders()[:6]}
    assert len(first) >= 3
    errors = [e for said in plant.heard if said.topic == "state" for e in said.body["errors"]]
    assert {e["errorType"] for e in errors} <= {"noOrderToCancel"}


def test_an_agv_that_is_killed_is_replaced(team: Team, plant: Plant) -> None:
    bring_in(plant, *VEHICLES)
    begin(team, plant)
    order = driving_delivery(plant)
    plant.kill_vehicle(order.robot)
    killed_s = plant.now_s()
    broken = plant.wait_for(
        lambda said: said.topic == "connection" and "BROKEN" in said.body["connectionState"],
        "the vehicle's last will",
    )
    instead = plant.wait_for(
        lambda said: said.topic == "order" and stop_of(said.body) == stop_of(order.body),
        "another vehicle gets the delivery",
        after_s=killed_s,
    )
    assert instead.robot != order.robot
    code, _ = team.end()
    assert code == 0, team.logs()
    assert sorted(finished(plant)) == sorted(WORK)
    LOG.info("AGV: will %.3f s, order %.3f s", broken.at_s - killed_s, instead.at_s - killed_s)


def test_a_vehicle_that_is_not_there_at_the_start_gets_no_work(team: Team, plant: Plant) -> None:
    """A retained CONNECTIONBROKEN of an earlier day."""
    bring_in(plant, *VEHICLES)
    plant.kill_vehicle("F1")
    plant.wait_for(
        lambda said: (
            (said.robot, said.topic) == ("F1", "connection")
            and "BROKEN" in said.body["connectionState"]
        ),
        "the last will of F1",
    )
    begin(team, plant)
    code, _ = team.end()
    assert code == 0, team.logs()
    assert plant.orders("F1") == []
    assert sorted(finished(plant)) == sorted(WORK)


def test_the_vehicle_of_a_robot_that_is_killed_stops(team: Team, plant: Plant) -> None:
    bring_in(plant, *VEHICLES)
    begin(team, plant)
    order = driving_delivery(plant)
    team.signal(order.robot, signal.SIGKILL)
    killed_s = plant.now_s()
    stopped = plant.wait_for(was_cancelled(order), "the vehicle stops", after_s=killed_s)
    instead = plant.wait_for(
        lambda said: said.topic == "order" and stop_of(said.body) == stop_of(order.body),
        "another vehicle gets the delivery",
        after_s=killed_s,
    )
    # First it stopped, then another one went: nothing was driven twice.
    assert stopped.at_s < instead.at_s
    assert instead.robot != order.robot
    code, _ = team.end()
    assert code == 0, team.logs()
    assert sorted(finished(plant)) == sorted(WORK)
    LOG.info("robot: stop %.3f s, order %.3f s", stopped.at_s - killed_s, instead.at_s - killed_s)


@pytest.mark.parametrize("end_broker", [Plant.kill_broker, Plant.stop_broker])
def test_orders_go_on_while_the_broker_is_started_again(
    team: Team, plant: Plant, end_broker: Callable[[Plant], None]
) -> None:
    bring_in(plant, *VEHICLES)
    begin(team, plant)
    driving_delivery(plant)
    end_broker(plant)
    plant.start_broker()
    code, _ = team.end()
    assert code == 0, team.logs()
    # No order was given twice, and none was taken back.
    assert sorted(stop_of(order.body) for order in plant.orders()) == sorted(WORK)
    assert not any(is_cancellation(said) for said in plant.heard)


def test_after_a_long_outage_of_the_broker_orders_are_taken_back_and_given_anew(
    team: Team, plant: Plant
) -> None:
    bring_in(plant, *VEHICLES)
    begin(team, plant)
    for stops in COUNTS:
        plant.wait_for(lambda s, w=stops: s.topic == "order" and stop_of(s.body) == w, "counted")
    plant.kill_broker()
    team.wait_until(
        lambda: all(
            any("no connection to the broker" in str(line.get("lost")) for line in team.log(robot))
            for robot in VEHICLES
        ),
        "all robots have told that they can do nothing",
    )
    plant.start_broker()
    code, _ = team.end()
    assert code == 0, team.logs()
    done = finished(plant)
    assert sorted(stops for stops in done if stops in DELIVERIES) == sorted(DELIVERIES)


def is_cancellation(said: Said) -> bool:
    actions = said.body.get("instantActions") or said.body.get("actions") or []
    return said.topic == "instantActions" and any(
        action["actionType"] == "cancelOrder" for action in actions
    )
