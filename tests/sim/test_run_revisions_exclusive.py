"""No revision begins an exclusive step again that was begun under any guards, in any mission
before, unless the operator says so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import TaskContext
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.changes import RevisionChanges, revision_changes
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.objections import objections
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Fault, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate, Revise

S = 1_000_000
FILE = """
mission: once
ends: never
local_tasks: {w: {parameters: [x], work: 1}, v: {parameters: [x], work: 8}}
conditions: {c1: {default: true}, c2: {default: true}}
robot_types: {r: {capabilities: {w: 1, v: 1}}}
robots: {R1: r, R2: r, R3: r}
global_tasks:
  e: {parameters: [x], needs: {w($x): {}}%s}
  t: {parameters: [x], needs: {w($x): {}}}
  u: {parameters: [x], needs: {v($x): {}}}
"""
SUBMIT = Operate("R1", "job/one", ["k", ["a"], 0, 0, 0, 0])


def mission(tree: str, exclusive: bool = True, work_s: int = 1) -> Mission:
    head = FILE % (", exclusive: true" if exclusive else "")
    head = head.replace(
        "{w: {parameters: [x], work: 1}", f"{{w: {{parameters: [x], work: {work_s}}}"
    )
    return mission_from_yaml(head + tree, "it.yaml", Path())


def team(*children: str) -> str:
    return f"tree: {{Parallel: {{success: all, children: [{', '.join(children)}]}}}}\n"


def job(*children: str) -> str:
    inner = f"{{Parallel: {{success: all, children: [{', '.join(children)}]}}}}"
    return f"jobs: {{k: {{parameters: {{p: [a, b]}}, tree: {inner}}}}}\ntree: {{Jobs: [k]}}\n"


def run(
    first: Mission, *changes: tuple[float, Mission, bool, bool], seconds: float = 30
) -> SimulationResult:
    """`changes`: when a revision is proposed, whether with --force, with --repeat-exclusive."""
    program = RobotProgram()

    async def work(task: TaskContext, *_: str) -> None:
        task.record_event({"began": f"{task.local_task}"})
        await anyio.sleep(task.simulation.duration_s)

    program.local_task("*")(work)
    faults: list[tuple[float, Fault]] = [(1.0, SUBMIT)] if first.jobs else []
    faults += [
        (at_s, Revise("R1", compile_mission(after), force, repeat))
        for at_s, after, force, repeat in changes
    ]
    schedule = [(round(at_s * S), fault) for at_s, fault in faults]
    result = simulate(first, program, seed=1, schedule=schedule, timeout_us=round(seconds * S))
    assert not result.violations, result.violations
    return result


def begun(result: SimulationResult) -> Counter[str]:
    return Counter(each["began"] for each in result.events if "began" in each)


def number_of(result: SimulationResult) -> int:
    (found,) = {agent.view.facts.in_force.number for agent in result.agents.values()}
    return found


def reason(result: SimulationResult, number: int) -> str:
    return next(iter(result.agents.values())).view.facts.index(Revisions).void_reason(number)


def foretold(result: SimulationResult, after: Mission) -> tuple[RevisionChanges, list[str]]:
    """What a dry run says at the end of a run."""
    facts = next(iter(result.agents.values())).view.facts
    revision = revise(facts.in_force, after, facts.index(Revisions).last_number + 1)
    changes = revision_changes(facts, revision)
    alive = {robot: known.incarnation for robot, known in facts.members.items()}
    return changes, objections(facts, revision, changes, alive, is_forced=True)


BEHIND = "{Sequence: [{Condition: c1}, %s]}"
# Steps that never began in the first mission, and are done in the second under other guards.
WAITING = "{Sequence: [u(z), {Parallel: {success: all, children: [%s]}}]}"


@pytest.mark.parametrize("shape", [team, job], ids=["team", "job"])
@pytest.mark.parametrize("exclusive", [True, False], ids=["exclusive", "ordinary"])
def test_back_to_a_mission_in_which_the_step_had_not_begun(
    shape: Callable[..., str], exclusive: bool
) -> None:
    a = mission(shape(WAITING % "t(s1), e(s2)"), exclusive)
    b = mission(shape("u(z)", BEHIND % "t(s1)", BEHIND % "e(s2)"), exclusive)
    done = run(a, (4.0, b, False, False), seconds=9)
    assert (number_of(done), begun(done)["w(s2)"]) == (1, 1)
    changes, refused = foretold(done, a)
    job_name = " of one" if shape is job else ""
    names = changes.to_json()
    assert {f"t(s1){job_name}", *([] if exclusive else [f"e(s2){job_name}"])} <= {
        *names["begun_again"]
    }
    assert names["new_tasks"] == []
    assert bool(refused) is exclusive
    for force in (False, True):
        back = run(a, (4.0, b, False, False), (9.0, a, force, False))
        assert number_of(back) == (1 if exclusive else 2)
        assert begun(back)["w(s2)"] == (1 if exclusive else 2)
        if exclusive:
            assert f"e(s2){job_name} is exclusive" in reason(back, 2)
            assert "--repeat-exclusive" in reason(back, 2)
    again = run(a, (4.0, b, False, False), (9.0, a, False, True))
    assert (number_of(again), begun(again)["w(s2)"]) == (2, 2)


@pytest.mark.parametrize("shape", [team, job], ids=["team", "job"])
def test_a_step_is_named_a_second_time(shape: Callable[..., str]) -> None:
    twice = shape("e(s1)", "e(s1)", "t(s2)", "t(s2)", "u(z)")
    # The job is open while one of its steps runs.
    a = mission(shape("e(s1)", "t(s2)", "u(z)"))
    result = run(a, seconds=6)
    changes, refused = foretold(result, mission(twice))
    of_job = " of one" if shape is job else ""
    assert changes.to_json()["new_tasks"] == [f"e(s1){of_job}", f"t(s2){of_job}"]
    assert changes.to_json()["begun_again"] == []
    assert [each.partition(" is ")[0] for each in refused] == [f"e(s1){of_job}"]
    revised = run(a, (6.0, mission(twice), True, False))
    assert (number_of(revised), begun(revised)["w(s1)"]) == (0, 1)
    revised = run(a, (6.0, mission(twice), False, True))
    assert (number_of(revised), begun(revised)["w(s1)"]) == (1, 2)


@pytest.mark.parametrize("exclusive", [(True, True), (True, False), (False, True)])
def test_a_step_under_way_is_cancelled_and_done_again_only_with_both_words(
    exclusive: tuple[bool, bool],
) -> None:
    """Also if the task is exclusive only in one of both missions."""
    slow = tuple(
        mission(team(*steps), each, 8)
        for steps, each in zip((["e(s1)"], [BEHIND % "e(s1)"]), exclusive, strict=True)
    )
    for force, repeat, number in (
        (False, False, 0),
        (True, False, 0),
        (False, True, 0),
        (True, True, 1),
    ):
        result = run(slow[0], (5.0, slow[1], force, repeat), seconds=9)
        assert number_of(result) == number, (force, repeat, begun(result))


def test_what_was_removed_never_begun_and_comes_back_is_new_and_not_done() -> None:
    a, without = mission(team(WAITING % "t(s1)")), mission(team("u(z)"))
    result = run(a, (4.0, without, False, False), seconds=6)
    changes, refused = foretold(result, a)
    assert (changes.new_tasks, changes.kept, refused) == (("t(s1)",), (), [])
    # Done, removed and back: it stays done, and is no new task.
    done = mission(team("t(s1)", "u(z)"))
    changes, refused = foretold(run(done, (5.0, without, False, False), seconds=7), done)
    assert changes.to_json()["kept"] == ["t(s1)"]
    assert (changes.new_tasks, refused) == ((), [])
