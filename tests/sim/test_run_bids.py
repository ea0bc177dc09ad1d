"""Bids over a bad network and with robots that die, in virtual time."""

from __future__ import annotations

import json
from collections.abc import Callable

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.facts.records import split_name
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.bids.facts import Bid
from mrbt_mesh.features.bids.needs import CLOSED
from mrbt_mesh.sim import Kill, LinkKnobs, NetworkKnobs, Restart, SimulationResult, simulate
from tests.support.build import action, make_mission, task
from tests.support.effort import seeds
from tests.support.runs import Run

SECOND_US = 1_000_000


def fetch(within_us: int) -> Mission:
    need = ("drive", 1, 1, True, within_us)
    team = {robot: {"drive": 1} for robot in ("A", "B", "C")}
    return make_mission(action("fetch"), team, [task("fetch", need)])


def drivers(bid: Callable[[TaskContext], object]) -> RobotProgram:
    program = RobotProgram()
    program.bid("drive")(bid)

    @program.local_task("drive")
    async def drive(task: TaskContext) -> None:
        task.record_event({"t": task.unix_time_s(), "robot": task.robot})
        await anyio.sleep(1)

    return program


def started(result: SimulationResult) -> tuple[str, float]:
    """Who drove, and when it began."""
    (event,) = result.events
    return event["robot"], event["t"]


def closed(result: SimulationResult) -> list[str]:
    return [e.name for e in result.observer.facts.map if split_name(e.name)[0] == CLOSED]


async def distances(task: TaskContext) -> float:
    """B is best, and takes its time to find out."""
    if task.robot == "B":
        await anyio.sleep(2)
    return {"A": -7, "B": -1, "C": -5}[task.robot]


def test_the_plan_waits_for_the_last_bid() -> None:
    result = simulate(fetch(9 * SECOND_US), drivers(distances), seed=1)
    robot, at_s = started(result)
    assert (robot, result.result, result.violations) == ("B", "success", [])
    assert at_s >= 2
    assert not closed(result)


def test_the_deadline_ends_the_waiting() -> None:
    result = simulate(fetch(SECOND_US), drivers(distances), seed=1)
    robot, at_s = started(result)
    assert (robot, result.result, result.violations) == ("C", "success", [])
    assert 1 <= at_s < 2
    assert closed(result)


def test_a_robot_that_dies_before_it_has_bid_is_not_waited_for() -> None:
    schedule = [(SECOND_US, Kill("B"))]
    result = simulate(fetch(9 * SECOND_US), drivers(distances), seed=1, schedule=schedule)
    robot, at_s = started(result)
    assert (robot, result.result, result.violations) == ("C", "success", [])
    assert 1 <= at_s < 2
    assert not closed(result)


def test_a_robot_that_starts_again_bids_as_before() -> None:
    """Its program would say something else now."""
    asked: list[str] = []

    async def fickle(task: TaskContext) -> float:
        asked.append(task.robot)
        if task.robot == "B":
            await anyio.sleep(3)
        return 9 if asked.count("C") > 1 else {"A": -7, "B": -9, "C": -8}[task.robot]

    schedule = [(SECOND_US, Kill("C")), (SECOND_US * 3 // 2, Restart("C"))]
    result = simulate(fetch(9 * SECOND_US), drivers(fickle), seed=1, schedule=schedule)
    assert (started(result)[0], result.result, result.violations) == ("A", "success", [])
    assert asked.count("C") == 1
    bids = {e.author: e.record for e in result.observer.facts.map if isinstance(e.record, Bid)}
    assert bids["C"] == Bid(-8_000_000)


@pytest.mark.parametrize("seed", seeds(6))
def test_couriers_deliver_over_a_network_that_loses_a_third(run: Run, seed: int) -> None:
    """Bids are told once: what is lost is repaired, or the time for bids passes."""
    knobs = NetworkKnobs(LinkKnobs(loss_permille=330, delay_us=20_000, jitter_us=60_000))
    result = run("couriers", seed, network=knobs)
    assert len(result.summary["bids"]) == 6


def test_the_warehouse_goes_on_without_a_fork_lift(run: Run) -> None:
    result = run("warehouse", 3, schedule=[(9 * SECOND_US, Kill("F1"))])
    tasks = result.summary["global_tasks"]
    assert {row["status"] for row in tasks.values()} == {"success"}
    assert len(tasks) == 10


def test_a_robot_tells_all_its_bids_in_one_message(run: Run) -> None:
    """Two stages of three parcels each: two messages per courier, with three bids each."""
    told: dict[str, list[int]] = {}
    for line in run("couriers", 1, keep_log=True).effect_log:
        robot, effect = line.split(" ", 2)[1:]
        written = json.loads(effect)
        if written.get("at_once"):
            bids = [name for _, name, _ in written["persist"] if name.startswith("bid/")]
            if bids:
                told.setdefault(robot, []).append(len(bids))
    assert told == {robot: [3, 3] for robot in ("K1", "K2", "K3", "K4")}


def test_without_a_bid_in_time_the_mission_goes_on_all_the_same(run: Run) -> None:
    def broken(task: TaskContext) -> float:
        raise RuntimeError("no map")

    result = simulate(fetch(SECOND_US), drivers(broken), seed=1, keep_log=True)
    assert (started(result)[0], result.result, result.violations) == ("A", "success", [])
    assert sum("bid_failed" in line for line in result.effect_log) == 3
