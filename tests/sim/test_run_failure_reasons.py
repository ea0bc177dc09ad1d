"""Whole runs whose trees ask why something failed."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine
from mrbt_mesh.sim import Freeze, Kill, Schedule, SimulationResult, Thaw, simulate
from mrbt_mesh.sim.world.setup import AgentOptions
from tests.support import behaviour
from tests.support.behaviour import mission_of, starts
from tests.support.effort import seeds

S = 1_000_000
ENGINES = (FASTEST, DEFINITIONS)
HEAD = """
mission: reasons
local_tasks: {drive: {parameters: [place]}, clear: {}, charge: {}}
conditions:
  blocked: {parameters: [place], failure_reason: {global_task: go($place), contains: no path}}
  tired: {failure_reason: {local_task: drive(dock), equals: battery low}}
robot_types: {T: {capabilities: {drive: 1, clear: 1, charge: 1}}}
robots: {R1: {type: T, capabilities: {drive: 5}}, R2: T, R3: T}
global_tasks:
  go: {parameters: [place], needs: {drive($place): {}}, failure: paper}
  clear: {needs: {clear: {}}}
  charge: {needs: {charge: {}}}
"""
TREE = """
tree:
  Fallback:
    - go(dock)
    - Sequence: [{Condition: blocked(dock)}, clear]
    - Sequence: [{Condition: tired}, charge]
"""


def run(
    behave: str,
    tree: str = TREE,
    schedule: Schedule = (),
    seed: int = 1,
    engine: Engine = FASTEST,
    head: str = HEAD,
) -> SimulationResult:
    """Simulate; no invariant may break on the way."""
    result = simulate(
        mission_of(head + f"parameters: {{behave: {{{behave}}}}}\n" + tree),
        behaviour.robot,
        seed=seed,
        schedule=schedule,
        timeout_us=60 * S,
        agents=AgentOptions(engine=engine),
    )
    assert not result.violations
    return result


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("reason", "instead"),
    [("sorry, no path to dock", "clear"), ("battery low", "charge"), ("battery low!", None)],
)
def test_the_reason_decides_what_is_done_instead(
    reason: str, instead: str | None, engine: Engine
) -> None:
    result = run(f"drive: {{fails: true, reason: '{reason}'}}", engine=engine)
    tasks = [task for _, task in starts(result)]
    assert tasks == ["drive(dock)", *([instead] if instead else [])]
    assert result.result == ("success" if instead else "failure")


def test_the_summary_tells_who_failed_at_what_and_why() -> None:
    result = run("drive: {fails: true, reason: no path}")
    (failure,) = result.summary["failures"]
    assert failure.pop("at_s") == pytest.approx(1, abs=0.5)
    assert failure == {
        "robot": "R1",
        "global_task": "go(dock)",
        "local_task": "drive(dock)",
        "reason": "no path",
    }
    texts = [text for _, text in result.observer.record.timeline]
    assert "R1: drive(dock) failed: no path" in texts


def test_every_robot_reads_the_same_whatever_the_network_does() -> None:
    result = run("drive: {fails: true, reason: no path}")
    facts = [agent.view.facts for agent in result.agents.values()]
    assert [each.condition("blocked(dock)") for each in facts] == [True] * 3
    assert [each.condition("tired") for each in facts] == [False] * 3


def test_a_success_after_that_takes_it_back() -> None:
    """Another robot succeeds where the first one failed."""
    head = HEAD.replace(", failure: paper", "")
    result = run("drive: {fails: [R1], reason: no path}", head=head)
    assert [task for _, task in starts(result)] == ["drive(dock)"] * 2
    conditions = [(n, v) for _, n, v in result.observer.record.conditions]
    assert conditions == [("blocked(dock)", True), ("blocked(dock)", False)]
    assert result.result == "success"


def test_each_attempt_counts_anew() -> None:
    """It fails three times; every time the same way out is tried again."""
    body = TREE.split("tree:", 1)[1].replace("\n  ", "\n      ")
    tree = f"tree:\n  Repeat:\n    cycles: 3\n    do:{body}"
    result = run("drive: {fails: true, reason: no path}", tree)
    assert [task for _, task in starts(result)] == ["drive(dock)", "clear"] * 3
    assert result.result == "success"


def test_where_every_robot_has_its_own_it_is_the_one_that_failed() -> None:
    head = HEAD.replace("tired: {", "tired: {per: robot, ").replace(", failure: paper", "")
    result = run("drive: {fails: [R1], reason: battery low}", head=head)
    view = next(iter(result.agents.values())).view.facts
    assert view.condition("tired@R1")
    assert not view.condition("tired@R2")


@pytest.mark.parametrize("seed", seeds(4))
def test_a_death_in_between_changes_nothing(seed: int) -> None:
    """R1 fails and dies; the others go on from what it said."""
    schedule: Schedule = [
        (1_200_000 + 40_000 * seed, Kill("R1")),
        (1_300_000, Freeze("R2")),
        (1_900_000, Thaw("R2")),
    ]
    result = run("drive: {fails: true, reason: no path}", schedule=schedule, seed=seed)
    assert result.result == "success"
    assert starts(result)[-1][1] == "clear"
