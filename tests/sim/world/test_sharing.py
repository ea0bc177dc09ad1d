"""Runs without inspection: faster, because robots read and plan together, and not different."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.engine import FASTEST, Engine
from mrbt_mesh.core.membership.wire import Header, WireError
from mrbt_mesh.sim import AgentOptions, NetworkKnobs, SimulationResult, simulate
from mrbt_mesh.sim.world import faults as f
from mrbt_mesh.sim.world import sharing
from mrbt_mesh.sim.world.network import LinkKnobs
from tests.support.effort import seeds
from tests.support.runs import example

SECOND_US = 1_000_000
SCHEDULE = (
    (4 * SECOND_US, f.Kill("C1")),
    (6 * SECOND_US, f.Lose("A1", "do_diagnosis")),
    (7 * SECOND_US, f.Freeze("B2")),
    (9 * SECOND_US, f.Restart("C1")),
    (11 * SECOND_US, f.Thaw("B2")),
    (15 * SECOND_US, f.Kill("A2")),
)
LOSSY = NetworkKnobs(LinkKnobs(loss_permille=100, duplicate_permille=50, reorder_permille=100))


def story(result: SimulationResult) -> tuple[Any, ...]:
    """All that a run without inspection still tells."""
    plans = {
        robot: agent.view.plan.packed for robot, agent in result.agents.items() if agent.view.plan
    }
    return result.result, result.duration_us, result.summary, result.events, result.stops, plans


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["vehicle_repair", "dispense", "explore", "tool_search", "couriers"]
)
@pytest.mark.parametrize("seed", [1, 2])
def test_inspection_changes_nothing_of_a_run(name: str, seed: int) -> None:
    mission, program = example(name)
    watched = simulate(mission, program, seed=seed)
    alone = simulate(mission, program, seed=seed, inspect=False)
    assert story(alone) == story(watched), f"{name}, seed {seed}"
    assert watched.checks
    assert watched.effect_log_digest
    assert not alone.checks
    assert not alone.effect_log_digest


@pytest.mark.parametrize("seed", seeds(4))
def test_nor_with_faults_and_a_bad_network(seed: int) -> None:
    mission, program = example("vehicle_repair")
    options: dict[str, Any] = {"seed": seed, "schedule": SCHEDULE, "network": LOSSY}
    watched = simulate(mission, program, **options)
    alone = simulate(mission, program, **options, inspect=False)
    assert story(alone) == story(watched), f"seed {seed}"
    assert watched.violations == []


def test_a_message_is_read_and_a_plan_made_once() -> None:
    counts = {"plan": 0, "read_beat": 0, "read_batch": 0}

    def counted(name: str, function: Any) -> Any:
        def call(*arguments: Any) -> Any:
            counts[name] += 1
            return function(*arguments)

        return call

    engine = Engine(
        read_heartbeat=counted("read_beat", FASTEST.read_heartbeat),
        read_batch=counted("read_batch", FASTEST.read_batch),
        plan_making=lambda *chosen: counted("plan", FASTEST.plan_making(*chosen)),
    )
    mission, program = example("vehicle_repair")
    agents = AgentOptions(engine=engine)
    result = simulate(mission, program, seed=1, agents=agents, inspect=False)
    told = sum(agent.view.facts.changes for agent in result.agents.values())
    assert counts["read_beat"] == 0, "nobody needs to read what a robot here wrote"
    assert 0 < counts["read_batch"] < told / len(result.agents)
    assert 0 < counts["plan"] < told / 2


def test_what_is_malformed_is_refused_by_everybody() -> None:
    header = Header("0" * 16, "m", "r", "")
    shared = sharing.shared_engine(header, FASTEST)
    for _ in range(2):
        with pytest.raises(WireError, match="not msgpack"):
            shared.read_batch("A1", b"\xc1", header)
        with pytest.raises(WireError, match="not msgpack"):
            shared.read_heartbeat("A1", b"\xc1", header, lambda row: True)


def test_what_is_remembered_is_bounded() -> None:
    recent: sharing.Recent[int, int] = sharing.Recent()
    for number in range(3 * sharing.RECENT):
        recent[number] = number
        assert len(recent) <= sharing.RECENT
        assert recent[number] == number
