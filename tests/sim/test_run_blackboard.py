"""What a robot has found is an argument of a later task, also under faults."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import RobotProgram, TaskContext
from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim import Kill, Restart, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.world.setup import AgentOptions
from tests.sim.test_run_jobs import submit
from tests.support import behaviour
from tests.support.behaviour import mission_of, starts

S = 1_000_000

HEAD = """
mission: sorting
local_tasks: {look: {sets: [found]}, fetch: {parameters: [what]}, charge: {}, wait: {}}
blackboard:
  found: {values: [red, blue]}
  count: {min: 0, max: 9, default: 0}
  battery: {min: 0, max: 100, decimals: 1, per: robot}
robot_types: {T: {capabilities: {look: 1, fetch: 1, charge: 1, wait: 1}}}
robots: {R1: {type: T, capabilities: {look: 5}}, R2: {type: T, capabilities: {fetch: 5}}, R3: T}
global_tasks:
  look: {needs: {look: {}}}
  get: {parameters: [what], needs: {fetch($what): {min: 2, max: 2}}}
  charge: {needs: {charge: {}}}
  wait: {needs: {wait: {}}}
"""
TREE = "tree: {Sequence: [look, get($found)]}\n"


def run(
    tree: str,
    behave: str,
    schedule: Schedule = (),
    expect: str = "success",
    engine: Engine = FASTEST,
    head: str = HEAD,
) -> SimulationResult:
    """Simulate; no invariant may break on the way."""
    result = simulate(
        mission_of(head + f"parameters: {{behave: {{{behave}}}}}\n" + tree),
        behaviour.robot,
        seed=1,
        schedule=schedule,
        timeout_us=30 * S,
        agents=AgentOptions(engine=engine),
    )
    assert not result.violations
    assert result.result == expect, result.summary["blocked"]
    return result


def test_what_the_first_task_finds_is_the_argument_of_the_second_one() -> None:
    for engine in (FASTEST, DEFINITIONS):
        found = starts(run(TREE, "look: {values: {found: blue}}", engine=engine))
        assert found[0] == ("R1", "look")
        assert [task for _, task in found[1:]] == ["fetch(blue)", "fetch(blue)"]


def test_a_task_waits_for_a_value_that_nobody_has_set() -> None:
    result = run(TREE, "", expect="timeout")
    assert starts(result) == [("R1", "look")]


def test_all_robots_of_an_activation_have_the_value_with_which_it_began() -> None:
    """R3 dies at work; meanwhile `wait` has set another value. R2 goes on with the first one."""
    tree = "tree: {Parallel: [{Sequence: [look, get($found)]}, wait]}\n"
    behave = "look: {values: {found: red}}, fetch: {seconds: 6}"
    behave += ", wait: {seconds: 3, values: {found: blue}}"
    found = starts(run(tree, behave, ((5 * S, Kill("R3")),)))
    fetched = [(robot, task) for robot, task in found if task.startswith("fetch")]
    assert len(fetched) == 3
    assert {task for _, task in fetched} == {"fetch(red)"}


def test_work_behind_a_comparison_is_done_again_when_it_turns() -> None:
    """`charge` is behind count >= 3, which holds twice."""
    tree = """
tree:
  Sequence:
    - {Fallback: [{Condition: count >= 3}, look]}
    - charge
    - wait
ends: never
"""
    head = HEAD.replace("sets: [found]", "sets: [found, count]")
    behave = "look: {values: {count: 4}}, wait: {values: {count: 2}}"
    result = run(tree, behave, expect="timeout", head=head)
    rounds = [task for _, task in starts(result)]
    assert rounds[:8] == ["look", "charge", "wait"] * 2 + ["look", "charge"]


def test_only_robots_for_which_a_comparison_holds_are_asked() -> None:
    tree = """
tree:
  Sequence: [look, {Condition: battery < 30}, charge]
ends: never
"""
    behave = "look@R1: {values: {battery: 12.5}}, charge: {values: {battery: 100}}"
    result = run(tree, behave, expect="failure")  # then it has become full, and looks again
    assert starts(result)[:2] == [("R1", "look"), ("R1", "charge")]


def test_what_a_dead_robot_has_set_of_its_own_is_no_longer_set() -> None:
    """R1 is killed while it charges: nobody has a low battery, until it is back and says so."""
    tree = """
tree:
  Parallel:
    - look
    - Fallback: [{Sequence: [{Condition: battery < 30}, charge]}, wait]
ends: never
"""
    behave = "look@R1: {values: {battery: 12.5}}, charge: {seconds: 9}"
    schedule = ((3 * S, Kill("R1")), (12 * S, Restart("R1")))
    result = run(tree, behave, schedule, expect="success")
    facts = result.observer.facts
    assert starts(result).count(("R1", "charge")) >= 2
    assert {robot for robot, task in starts(result) if task == "charge"} == {"R1"}
    gone = [value for _, name, value in result.observer.record.conditions if name == "battery@R1"]
    assert [value for value, _ in groupby(gone)] == [125, None, 125]
    assert facts.conditions.entry("battery@R2") is None


JOBS = """
mission: sorting
ends: never
local_tasks: {look: {parameters: [shelf], sets: [found]}, fetch: {parameters: [what]}}
blackboard: {found: {values: [red, blue], per: job}}
robot_types: {T: {capabilities: {look: 1, fetch: 1}}}
robots: {R1: T, R2: T, R3: T}
global_tasks:
  look: {parameters: [shelf], needs: {look($shelf): {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
jobs:
  sort:
    parameters: {shelf: [a, b], skipped: [red, blue]}
    tree:
      Sequence:
        - look($shelf)
        - Inverter: {Condition: found == $skipped}
        - get($found)
tree: {Jobs: all}
"""


@pytest.mark.parametrize("fault", [(), ((2_500_000, Kill("R1")), (4 * S, Restart("R1")))])
def test_each_job_has_its_own_value(fault: Schedule) -> None:
    program = RobotProgram()
    fetched: list[str] = []

    @program.local_task
    async def look(task: TaskContext, shelf: str) -> dict[str, str]:
        await anyio.sleep(1)
        return {"found": {"a": "red", "b": "blue"}[shelf]}

    @program.local_task
    async def fetch(task: TaskContext, what: str) -> None:
        await anyio.sleep(1)
        fetched.append(what)
        assert task.read_value("found") == what

    jobs = [("j1", "a", "blue"), ("j2", "b", "red"), ("j3", "a", "red"), ("j4", "b", "red")]
    schedule = tuple((S, submit("R2", name, "sort", *each)) for name, *each in jobs)
    result = simulate(
        mission_from_yaml(JOBS, "m", Path()),
        program,
        seed=2,
        schedule=(*schedule, *fault),
        timeout_us=30 * S,
    )
    assert not result.violations
    assert sorted(fetched) == ["blue", "blue", "red"]
