"""Teams whose robots are clients of routers, which die while the team works."""

from __future__ import annotations

import random
from itertools import takewhile

import pytest

from mrbt_mesh.core.facts.store import Incarnation
from mrbt_mesh.core.membership.membership import Membership
from mrbt_mesh.drills.physical import of, spans
from mrbt_mesh.sim import (
    EndRouter,
    Fault,
    Kill,
    NetworkKnobs,
    SimulationResult,
    StartRouter,
)
from mrbt_mesh.sim.world.network import FAILOVER_US, Routers
from tests.support.runs import Run, undisturbed

MS = 1_000
SECOND_US = 1_000 * MS
SPEED = 4.0
LENGTH_US = 6_200_000  # of a run at SPEED
TWO = NetworkKnobs(routers=("r1", "r2"))
NO_TOKENS = NetworkKnobs(routers=("r1", "r2"), token_delay_us=None)
SLOW_TOKENS = NetworkKnobs(routers=("r1", "r2"), token_delay_us=50 * MS)


def deaths_of_routers(seed: int) -> list[tuple[int, Fault]]:
    """Now the one dies, now the other; it is back before the other may die."""
    choose, at_us = random.Random(f"{seed}/deaths"), 0
    schedule: list[tuple[int, Fault]] = []
    while at_us < LENGTH_US:
        at_us += choose.randint(400 * MS, 1_500 * MS)
        router = choose.choice(["r1", "r2"])
        schedule += [(at_us, EndRouter(router)), (at_us + 390 * MS, StartRouter(router))]
    return schedule


def deaths(result: SimulationResult) -> list[str]:
    """Who was held for dead, by any robot, before the first one was done and left."""
    log = takewhile(lambda line: '"Stop"' not in line, result.effect_log)
    return [line for line in log if "robot_dead" in line]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "network"), [*((seed, TWO) for seed in range(3)), (6, SLOW_TOKENS), (7, NO_TOKENS)]
)
def test_nobody_is_held_for_dead_when_routers_die(
    run: Run, seed: int, network: NetworkKnobs
) -> None:
    result = run(
        "vehicle_repair",
        seed,
        schedule=deaths_of_routers(seed),
        network=network,
        speed=SPEED,
        keep_log=True,
    )
    assert result.fault_counts["EndRouter"] > 4
    assert deaths(result) == []
    assert result.summary["takeovers"] == []


@pytest.mark.parametrize("seed", range(2))
def test_any_a_or_b_may_be_killed_while_routers_die(run: Run, seed: int) -> None:
    choose = random.Random(seed)
    kill = (choose.randrange(LENGTH_US), Kill(choose.choice(["A1", "A2", "B1", "B2"])))
    schedule = [*deaths_of_routers(seed), kill]
    result = run("vehicle_repair", seed, schedule=schedule, network=TWO, speed=SPEED)
    takeovers = [takeover["robot"] for takeover in result.summary["takeovers"]]
    assert set(takeovers) <= {kill[1].robot}


def test_a_robot_killed_behind_a_living_router_is_replaced_at_once(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    at_us = round((before.start_s + 0.7) * 1e6)
    schedule: list[tuple[int, Fault]] = [(at_us, Kill(before.robot))]
    result = run("vehicle_repair", 3, schedule=schedule, network=TWO)
    _, replacement = of(spans(result.events), "replace_hw", before.part)
    assert 0 < replacement.start_s - at_us / 1e6 < 0.05


def test_a_robot_that_dies_together_with_its_router_is_found_by_its_silence(run: Run) -> None:
    before = of(undisturbed(3), "replace_hw")[0]
    at_us = round((before.start_s + 0.5) * 1e6)
    schedule: list[tuple[int, Fault]] = [
        (at_us - 1, EndRouter("r1")),
        (at_us - 1, StartRouter("r1")),
        (at_us - 1, EndRouter("r2")),
        (at_us - 1, StartRouter("r2")),
        (at_us, Kill(before.robot)),
    ]
    result = run("vehicle_repair", 3, schedule=schedule, network=TWO)
    _, replacement = of(spans(result.events), "replace_hw", before.part)
    assert 0.5 < replacement.start_s - at_us / 1e6 < 1.5


def test_without_any_router_for_less_than_the_detection_time_nobody_dies(run: Run) -> None:
    both = ("r1", "r2")
    schedule: list[tuple[int, Fault]] = [(2 * SECOND_US, EndRouter(name)) for name in both]
    schedule += [(2 * SECOND_US + 500 * MS, StartRouter("r2"))]
    result = run("vehicle_repair", 5, schedule=schedule, network=TWO, speed=SPEED)
    assert result.summary["takeovers"] == []


def test_without_asking_routers_a_client_of_a_dead_one_is_taken_for_dead(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The deliberate bug: these tests would notice if lost tokens counted at once."""

    def credulous(
        self: Membership, robot: str, life: Incarnation, is_held: bool, _: str = ""
    ) -> bool:
        return original(self, robot, life, is_held)

    original = Membership.receive_token
    monkeypatch.setattr(Membership, "receive_token", credulous)
    result = run(
        "vehicle_repair",
        0,
        schedule=deaths_of_routers(0),
        network=TWO,
        speed=SPEED,
        keep_log=True,
        expect=None,
    )
    assert deaths(result)


def test_the_same_seed_gives_the_same_run(run: Run) -> None:
    digests = {
        run(
            "vehicle_repair", 2, schedule=deaths_of_routers(2), network=TWO, speed=SPEED
        ).effect_log_digest
        for _ in range(2)
    }
    assert len(digests) == 1


def test_a_router_that_there_is_not_is_refused(run: Run) -> None:
    with pytest.raises(ValueError, match="the network has no router 'r9'"):
        run("vehicle_repair", 0, schedule=[(0, EndRouter("r9"))], network=TWO)


def test_clients_of_a_dead_router_find_a_living_one() -> None:
    routers = Routers(("r1", "r2"), 7)
    assert all(routers.link(robot) for robot in "ABCDEF")
    clients = {robot for robot, name in routers.of.items() if name == "r1"}
    gone = routers.end("r1")
    assert set(gone) == clients
    assert all(FAILOVER_US[0] <= without_us <= FAILOVER_US[1] for without_us in gone.values())
    assert not any(routers.reaches(robot) for robot in clients)
    robot = min(clients)
    assert routers.link(robot)
    assert (routers.of[robot], routers.is_linked(robot, "r2")) == ("r2", True)
    assert routers.is_linked(robot, "r1") is None
    routers.end("r2")
    assert not routers.link(robot)
    routers.begin("r1")
    assert routers.link(robot)
    assert routers.is_linked("A", "r1") is (robot == "A")
    routers.unlink(robot)
    assert routers.is_linked(robot, "r1") is False


def test_without_routers_robots_reach_each_other() -> None:
    routers = Routers((), 7)
    assert routers.reaches("A")
