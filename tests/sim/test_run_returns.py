"""What the record of a run says of a robot that was silent is what its observer hears."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import Freeze, Kill, LinkKnobs, NetworkKnobs, Suspend, Thaw, simulate
from tests.support import effort
from tests.support.paths import mission_file

S = 1_000_000
# For so long an observer and the robots may not agree yet.
SETTLE_US = 1_500_000


class Contradictions:
    """What the record and the observer's membership say otherwise of a robot, and since when."""

    def __init__(self) -> None:
        self.lasting: dict[tuple[str, str], int] = {}
        self._since: dict[tuple[str, str], int] = {}

    def look(self, observer: Observer, now_us: int) -> None:
        record = observer.record
        if record.result is not None:
            return
        dead = {fault.robot for fault in record.major if fault.until_us is None}
        found = set()
        for robot in observer.robots():
            state = observer.robot_state(robot)
            if (robot in dead) is not (state is State.DEAD):
                found.add((robot, "dead"))
            if record.robots.get(robot, {}).get("state", state) is not state:
                found.add((robot, "state"))
        self._since = {each: self._since.get(each, now_us) for each in found}
        for each, since_us in self._since.items():
            if now_us - since_us > SETTLE_US:
                self.lasting[each] = now_us - since_us


def faults_of(seed: int, robots: list[str]) -> list[tuple[int, Any]]:
    rng = random.Random(f"return/{seed}")
    found: list[tuple[int, Any]] = []
    for _ in range(rng.randint(1, 3)):
        robot, at_us = rng.choice(robots), rng.randrange(S // 2, 12 * S)
        for_us = rng.choice([rng.randrange(S // 5, S), rng.randrange(S, 6 * S)])
        found.append((at_us, rng.choice([Freeze, Freeze, Suspend])(robot)))
        found.append((at_us + for_us, Thaw(robot)))
    if rng.random() < 0.3:
        found.append((rng.randrange(S, 10 * S), Kill(rng.choice(robots))))
    return sorted(found, key=lambda each: each[0])


def freezes_of(seed: int, robots: list[str]) -> list[tuple[int, Any]]:
    """Several times some robots freeze together, often all of them, and thaw; one may be killed."""
    rng = random.Random(f"freezes/{seed}")
    found: list[tuple[int, Any]] = []
    at_us = rng.randrange(S // 2, 2 * S)
    for _ in range(rng.randint(1, 3)):
        count = len(robots) if rng.random() < 0.6 else rng.randint(1, len(robots))
        for_us = rng.choice([rng.randrange(S // 2, 2 * S), rng.randrange(2 * S, 8 * S)])
        for robot in rng.sample(robots, count):
            found.append((at_us + rng.randrange(S // 10), Freeze(robot)))
            found.append((at_us + for_us + rng.randrange(S // 10), Thaw(robot)))
        at_us += for_us + rng.randrange(S // 2, 4 * S)
    if rng.random() < 0.3:
        found.append((rng.randrange(S, at_us), Kill(rng.choice(robots))))
    return sorted(found, key=lambda each: each[0])


@pytest.mark.parametrize("faults", [faults_of, freezes_of])
@pytest.mark.parametrize("seed", effort.seeds(20))
def test_a_robot_that_is_back_is_dead_nowhere(
    seed: int, faults: Callable[[int, list[str]], list[tuple[int, Any]]]
) -> None:
    mission = load_mission(mission_file("vehicle_repair"))
    assert mission.program is not None
    delay_us, jitter_us = [(500, 0), (5_000, 2_000), (20_000, 40_000)][seed % 3]
    seen = Contradictions()
    simulate(
        mission,
        load_program(mission.program),
        seed=seed,
        schedule=faults(seed, sorted(mission.robots)),
        network=NetworkKnobs(LinkKnobs(delay_us=delay_us, jitter_us=jitter_us)),
        timeout_us=25 * S,
        inspect=False,
        look_on=seen.look,
    )
    assert seen.lasting == {}, f"seed {seed}"
