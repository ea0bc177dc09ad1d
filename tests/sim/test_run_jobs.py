"""Jobs handed to a team that runs, also under faults."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import TaskContext
from mrbt_mesh.cli.views.summary_view import JOB_STATES
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.job_rows import JobRows
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Fault, Kill, Restart, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import KillAfter, Operate, Revise, Unblock, partition
from mrbt_mesh.sim.world.setup import LAUNCH_UNIX_US
from tests.support.effort import seeds
from tests.support.mutations import MUTATIONS

S = 1_000_000
AT_US = LAUNCH_UNIX_US
FILE = """
mission: deliveries
ends: never
local_tasks:
  take: {parameters: [what], work: 2}
  put: {parameters: [what, where], work: 2}
  look: {parameters: [where], work: 1}
robot_types:
  cart: {capabilities: {take: 1, put: 1}}
  scout: {capabilities: {look: 1}}
robots: {A1: cart, A2: cart, B1: scout}
global_tasks:
  fetch: {parameters: [what], needs: {take($what): {min: 1}}}
  bring:
    parameters: [what, where]
    needs:
      put($what, $where):
        same_robot_as: {global_task: fetch($what), local_task: take($what)}
  check: {parameters: [where], needs: {look($where): {min: 1}}}
jobs:
  deliver:
    parameters: {what: {min: 1, max: 100}, where: [dock_1, dock_2]}
    tree: {Sequence: [fetch($what), 'bring($what, $where)', check($where)]}
  inspect:
    parameters: {where: [dock_1, dock_2]}
    priority: 5
    tree: check($where)
tree: {Jobs: {types: [deliver, inspect], at_most: 3}}
"""
MISSION = mission_from_yaml(
    FILE,
    "m.yaml",
    Path(),
)


def submit(
    robot: str,
    name: str,
    kind: str,
    *arguments: str,
    priority: int = 0,
    not_before_us: int = 0,
    deadline_us: int = 0,
) -> Fault:
    value = [kind, list(arguments), priority, not_before_us, deadline_us, 0]
    return Operate(robot, f"job/{name}", value, "me")


CHANGES = {
    "cancel": ("job_cancelled", True),
    "hold": ("job_hold", "held"),
    "hold_now": ("job_hold", "now"),
    "release": ("job_hold", "released"),
}


def change(robot: str, name: str, what: str, priority: int = 0) -> Fault:
    field, value = CHANGES.get(what, ("job_priority", priority))
    return Operate(robot, f"{field}/{name}", value, "me")


PROGRAM = RobotProgram(record_work=True)


async def work(task: TaskContext, *_: str) -> None:
    await anyio.sleep(task.simulation.duration_s)


for name in MISSION.local_tasks:
    PROGRAM.local_task(name)(work)


def run(
    *schedule: tuple[float, Fault], seconds: float = 60, seed: int = 1
) -> tuple[SimulationResult, dict[str, tuple[str, tuple[str, ...]]]]:
    """The result, and id -> state and robots of each job that has ended."""
    steps = [(round(at_s * S), fault) for at_s, fault in schedule]
    result = simulate(MISSION, PROGRAM, seed=seed, schedule=steps, timeout_us=round(seconds * S))
    assert result.violations == [], f"seed {seed}"
    jobs = result.observer.facts.jobs
    assert jobs is not None
    told = Counter[tuple[str, str]]()
    for kind, totals in result.summary.get("jobs", {}).items():
        told.update({(kind, state): totals[state] for state in JOB_STATES if totals[state]})
    rows = JobRows().of(result.observer)
    is_open = ("held", "waiting", "running")
    assert told == Counter(
        (row.type, "open" if row.state in is_open else row.state) for row in rows
    )
    return result, {k.id: (str(k.end.state), k.end.robots) for k in jobs if k.end is not None}


def works(result: SimulationResult) -> list[tuple[str, str, str, tuple[str, ...]]]:
    """(second, robot, local task, arguments) of all work that has ended."""
    ends = [event for event in result.events if event["event"] == "end"]
    return [(e["t"], e["robot"], e["local_task"], tuple(e["args"])) for e in ends]


@pytest.mark.parametrize("seed", seeds(5))
def test_jobs_are_done_in_the_order_of_their_steps_each_by_one_robot(seed: int) -> None:
    result, ends = run(
        (3, submit("A1", "one", "deliver", "7", "dock_1")),
        (3, submit("B1", "two", "deliver", "8", "dock_2")),
        seed=seed,
    )
    assert {name: state for name, (state, _) in ends.items()} == dict.fromkeys(
        ("one", "two"), "succeeded"
    )
    done = works(result)
    for what, where in (("7", "dock_1"), ("8", "dock_2")):
        mine = [each for each in done if what in each[3]]
        assert [(task, args) for _, _, task, args in mine] == [
            ("take", (what,)),
            ("put", (what, where)),
        ]
        assert len({robot for _, robot, _, _ in mine}) == 1, "same_robot_as holds within a job"


@pytest.mark.parametrize("seed", seeds(5))
def test_jobs_survive_the_robot_that_took_them_and_the_one_at_work(seed: int) -> None:
    jobs = [submit("A2", f"j{n}", "deliver", str(n + 1), "dock_1") for n in range(6)]
    deaths = [(3.2, Kill("A2")), (8.0, Restart("A2")), (12.0, Kill("B1")), (20.0, Restart("B1"))]
    result, ends = run(*[(3.0, job) for job in jobs], *deaths, seconds=90, seed=seed)
    assert {name: state for name, (state, _) in ends.items()} == {
        f"j{n}": "succeeded" for n in range(6)
    }
    facts = result.agents["A1"].view.facts
    assert not facts.activations, "nothing is kept of the trees of jobs that have ended"
    assert not any(known.commands for known in facts.jobs or ())


def test_the_same_id_again_is_the_same_job() -> None:
    again = submit("B1", "one", "inspect", "dock_1")
    result, ends = run((3, submit("A1", "one", "inspect", "dock_1")), (3, again), (9, again))
    assert ends == {"one": ("succeeded", ("B1",))}
    assert len(works(result)) == 1


def test_a_cancelled_job_is_stopped_and_a_held_one_waits() -> None:
    result, ends = run(
        (3.0, submit("A1", "one", "deliver", "1", "dock_1")),
        (3.5, submit("A1", "two", "deliver", "2", "dock_2")),
        (3.5, submit("A1", "three", "deliver", "3", "dock_2")),
        (3.6, change("A2", "three", "hold")),
        (4.0, change("B1", "one", "cancel")),
        (30.0, change("B1", "three", "release")),
    )
    assert {name: state for name, (state, _) in ends.items()} == {
        "one": "cancelled",
        "two": "succeeded",
        "three": "succeeded",
    }
    done = works(result)
    assert not any(args[0] == "1" for _, _, task, args in done if task in ("take", "put"))
    assert min(float(t) for t, _, _, args in done if args[0] == "3") > 30


@pytest.mark.parametrize("how", ["hold", "hold_now"])
@pytest.mark.parametrize("seed", seeds(10))
def test_no_further_step_of_a_held_job_begins_and_what_runs_goes_on_unless_it_is_to_end(
    seed: int, how: str
) -> None:
    job = (3.0, submit("A1", "one", "deliver", "1", "dock_1"))
    other = (12.0, submit("A1", "two", "deliver", "2", "dock_2"))
    hold, release = (4.2, change("B1", "one", how)), (30.0, change("A2", "one", "release"))
    result, ends = run(job, hold, other, seconds=28, seed=seed)
    assert ends == {"two": ("succeeded", ends["two"][1])}, "robots work on other jobs"
    mine = [e for e in result.events if e.get("args") and e["args"][0] == "1"]
    kinds = [e["event"] for e in mine]
    assert kinds == ["start", "end" if how == "hold" else "cancel"], seed
    assert max(float(e["t"]) for e in mine if e["event"] == "start") < 4.2
    result, ends = run(job, hold, other, release, seconds=60, seed=seed)
    assert ends["one"][0] == "succeeded"
    done = [task for _, _, task, args in works(result) if "1" in args or "dock_1" in args]
    assert sorted(done) == ["look", "put", "take"], "release goes on from there"


def test_that_a_step_of_a_held_job_begins_is_found() -> None:
    job = (3.0, submit("A1", "one", "deliver", "1", "dock_1"))
    hold = (4.2, change("B1", "one", "hold"))
    with (
        MUTATIONS["held_jobs_go_on"](),
        pytest.raises(AssertionError, match="of a job that is held"),
    ):
        run(job, hold, seconds=28)


@pytest.mark.parametrize("seed", seeds(5))
def test_a_cancellation_stays_visible_beside_what_a_robot_that_was_cut_off_has_done(
    seed: int,
) -> None:
    apart = partition({"B1"}, {"A1", "A2"})
    result, ends = run(
        (3.0, submit("A1", "one", "inspect", "dock_1", not_before_us=AT_US + 14 * S)),
        (6.0, apart),
        (8.0, Operate("A1", "job_cancelled/one", True, "me", ("A2",))),
        (20.0, Unblock(apart.links)),
        seed=seed,
    )
    assert ends == {"one": ("cancelled", ("B1",))}
    assert len(works(result)) == 1
    (row,) = JobRows().update(result.observer.facts, None, ())
    assert (row.state, row.why) == ("cancelled", "done all the same by B1, which was cut off")


def test_larger_priorities_go_first_also_when_they_change() -> None:
    waiting = [submit("A1", f"j{n}", "inspect", "dock_1", priority=0) for n in range(6)]
    result, ends = run(
        *[(3.0, job) for job in waiting],
        (3.0, submit("A1", "urgent", "inspect", "dock_2", priority=9)),
        (3.0, change("A1", "j5", "priority", priority=5)),
    )
    assert {state for state, _ in ends.values()} == {"succeeded"}
    starts = [e["activation"] for e in result.events if e["event"] == "start"]
    order = [activation.partition("@")[2].partition(":")[0] for activation in starts]
    assert order == ["urgent", "j5", "j0", "j1", "j2", "j3", "j4"]


@pytest.mark.parametrize("seed", seeds(5))
def test_the_whole_team_starts_again_and_goes_on_with_its_jobs(seed: int) -> None:
    jobs = [submit("A1", f"j{n}", "deliver", str(n + 1), "dock_1") for n in range(4)]
    everybody = ("A1", "A2", "B1")
    kills = [(6.0, Kill(robot)) for robot in everybody]
    restarts = [(8.0, Restart(robot)) for robot in everybody]
    _, ends = run(*[(3.0, job) for job in jobs], *kills, *restarts, seconds=90, seed=seed)
    assert {name: state for name, (state, _) in ends.items()} == {
        f"j{n}": "succeeded" for n in range(4)
    }


def test_a_job_waits_for_its_time_and_expires_at_its_deadline() -> None:
    result, ends = run(
        (3.0, submit("A1", "later", "deliver", "1", "dock_1", not_before_us=AT_US + 23 * S)),
        (3.0, submit("A1", "never", "deliver", "2", "dock_1", deadline_us=AT_US + 6 * S)),
        (8.0, Kill("A1")),
    )
    assert {name: state for name, (state, _) in ends.items()} == {
        "later": "succeeded",
        "never": "expired",
    }
    assert min(float(t) for t, _, _, args in works(result) if args[0] == "1") > 23


def test_a_revision_adds_a_type_of_jobs_to_a_team_with_open_ones() -> None:
    text = FILE.replace("[deliver, inspect]", "[deliver, inspect, recheck]").replace(
        "tree: {Jobs:",
        "  recheck:\n    parameters: {where: [dock_1, dock_2]}\n    tree: "
        "{Sequence: [check($where), 'fetch(7)']}\ntree: {Jobs:",
    )
    after = compile_mission(mission_from_yaml(text, "deliveries.yaml", Path()))
    _, ends = run(
        (3, submit("A1", "one", "deliver", "7", "dock_1")),
        (3, submit("A1", "two", "inspect", "dock_1")),
        (3.5, Revise("A1", after)),
        (4, submit("A2", "three", "recheck", "dock_2")),
        (5, Kill("A1")),
    )
    assert {name: state for name, (state, _) in ends.items()} == dict.fromkeys(
        ("one", "two", "three"), "succeeded"
    )


LAST = mission_from_yaml(
    """
mission: last
ends: never
local_tasks: {look: {work: 3}, pack: {work: 2}}
robot_types: {scout: {capabilities: {look: 1, pack: 1}}}
robots: {A1: scout, A2: scout, A3: scout}
global_tasks: {see: {needs: {look: {min: 1}}}, wrap: {needs: {pack: {min: 1}}}}
jobs: {visit: {tree: {Sequence: [see, wrap]}}}
tree: {Jobs: all}
""",
    "last.yaml",
    Path(),
)


@pytest.mark.parametrize("dead_at_s", [6.0, 8.5])
def test_the_last_robot_ends_the_job_that_it_has_done(dead_at_s: float) -> None:
    """Nobody is left who could confirm it, whether the others have done a part of it or not."""
    program = RobotProgram()
    for name in LAST.local_tasks:
        program.local_task(name)(work)
    kills = [(4.0, Kill("A1")), (dead_at_s, Kill("A2"))]
    steps = [(round(at_s * S), each) for at_s, each in [(5.0, submit("A2", "v", "visit")), *kills]]
    result = simulate(LAST, program, seed=1, schedule=steps, timeout_us=40 * S)
    (row,) = JobRows().of(result.observer)
    assert (row.state, row.robots[-1]) == ("succeeded", "A3")
    assert result.violations == []


def test_the_end_of_a_job_is_known_when_the_robot_that_has_done_it_dies() -> None:
    """The last robot has done nothing of it, and its word alone would not be enough."""
    program = RobotProgram(record_work=True)
    for name in LAST.local_tasks:
        program.local_task(name)(work)
    asked = [(4.0, Kill("A1")), (5.0, submit("A2", "v", "visit")), (5.0, KillAfter("A2", 2))]
    steps = [(round(at_s * S), each) for at_s, each in asked]
    result = simulate(LAST, program, seed=1, schedule=steps, timeout_us=40 * S)
    assert {event["robot"] for event in result.events} == {"A2"}
    (row,) = JobRows().of(result.observer)
    assert row.state == "succeeded"
