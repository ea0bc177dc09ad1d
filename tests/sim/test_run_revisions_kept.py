"""What a revision keeps: places, ends of jobs, steps of jobs, attempts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import anyio
import pytest

from mrbt_mesh import TaskContext, TaskFailedError
from mrbt_mesh.core.facts import team_facts
from mrbt_mesh.core.facts.records import JobEnd, Record
from mrbt_mesh.core.facts.store import Entry
from mrbt_mesh.core.facts.validation import believed
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions import revise as numbering
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.observer.headline import headline
from mrbt_mesh.runtime.program import RobotProgram
from mrbt_mesh.sim import Fault, Kill, Restart, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Freeze, Operate, Revise, Thaw

S = 1_000_000


def mission(text: str) -> Mission:
    return mission_from_yaml(text, "it.yaml", Path())


def submit(job: str, kind: str, *arguments: str, robot: str = "A1") -> Operate:
    return Operate(robot, f"job/{job}", [kind, list(arguments), 0, 0, 0, 0])


def revised(text: str, forced: bool = False, repeat: bool = False, robot: str = "A2") -> Revise:
    return Revise(robot, compile_mission(mission(text)), forced, repeat)


async def drive(task: TaskContext, place: str) -> None:
    await anyio.sleep(2)


def run(
    text: str, *faults: tuple[float, Fault], seconds: float = 40, failures: int = 0
) -> SimulationResult:
    """`failures`: how often work fails at first."""
    program, failed = RobotProgram(), [0]

    async def work(task: TaskContext, *arguments: str) -> None:
        what = f"{task.local_task}"
        task.record_event({"began": what, "robot": task.robot})
        await anyio.sleep(task.simulation.duration_s)
        if failed[0] < failures:
            failed[0] += 1
            raise TaskFailedError("not yet")
        task.record_event({"done": what, "robot": task.robot})

    program.local_task("*")(work)
    program.travel(drive)
    schedule = [(round(at_s * S), fault) for at_s, fault in faults]
    result = simulate(
        mission(text), program, seed=1, schedule=schedule, timeout_us=round(seconds * S)
    )
    violations = [v for v in result.violations if "I6" not in str(v)]
    assert not violations, violations
    return result


def count(result: SimulationResult, what: str = "done") -> Counter[str]:
    return Counter(each[what] for each in result.events if what in each)


def in_force(result: SimulationResult) -> set[int]:
    return {agent.view.facts.in_force.number for agent in result.agents.values()}


def state_of(result: SimulationResult, job: str) -> set[str]:
    found = set()
    for agent in result.agents.values():
        jobs = agent.view.facts.jobs
        known = jobs.known.get(job) if jobs is not None else None
        found.add(str(known.end.state) if known and known.end else "open" if known else "unknown")
    return found


# -- places ---------------------------------------------------------------------------------------

PLACES = """
mission: depot
ends: never
travel:
  places: {%s}
  speed: 1
  start: {A1: p0, A2: p0, A3: p0}
local_tasks: {la: {parameters: [n, p], work: 4, at: $p}}
robot_types: {A: {capabilities: {la: 1}}}
robots: {A1: A, A2: A, A3: A}
global_tasks:
  do: {parameters: [n, p], needs: {"la($n, $p)": {min: 1}}}
jobs:
  a: {parameters: {n: {min: 1, max: 99}, p: place}, tree: 'do($n, $p)'}
tree: {Jobs: {types: all, at_most: 20}}
"""
WITH_P2 = PLACES % "p0: [0, 0], p1: [2, 0], p2: [-1, 0]"
WITHOUT_P2 = PLACES % "p0: [0, 0], p1: [2, 0]"
NO_PLACES = """
mission: depot
ends: never
local_tasks: {la: {parameters: [n, p], work: 4}}
robot_types: {A: {capabilities: {la: 1}}}
robots: {A1: A, A2: A, A3: A}
global_tasks:
  do: {parameters: [n, p], needs: {"la($n, $p)": {min: 1}}}
jobs:
  b: {parameters: {n: {min: 1, max: 99}, p: [p1]}, tree: 'do($n, $p)'}
tree: {Jobs: {types: all, at_most: 20}}
"""


@pytest.mark.parametrize("without", [WITHOUT_P2, NO_PLACES], ids=["without p2", "without places"])
def test_a_robot_stands_at_a_place_that_is_removed_and_comes_back(without: str) -> None:
    kind = "a" if without is WITHOUT_P2 else "b"
    result = run(
        WITH_P2,
        (3, submit("x", "a", "1", "p2")),
        (13, revised(without)),
        *((14 + i / 10, submit(f"y{i}", kind, str(2 + i), "p1")) for i in range(4)),
        (25, revised(WITH_P2, forced=True)),
        *((27 + i / 10, submit(f"z{i}", "a", str(12 + i), "p2")) for i in range(3)),
        seconds=50,
    )
    assert in_force(result) == {2}
    assert all(state_of(result, each) == {"succeeded"} for each in ("x", "y3", "z0", "z2"))
    assert set(count(result).values()) == {1}
    # It stands there still, as far as the team knows.
    facts = next(iter(result.agents.values())).view.facts
    assert {facts.place_of(robot) for robot in ("A1", "A2", "A3")} >= {"p2"}


def test_a_robot_is_on_its_way_to_a_place_that_is_removed_while_it_is_dead() -> None:
    """Its claim, and the travel that it names, say nothing; the job must be cancelled first."""
    refused = run(WITH_P2, (3, submit("x", "a", "1", "p2")), (4, revised(WITHOUT_P2, True)))
    assert in_force(refused) == {0}
    result = run(
        WITH_P2,
        (3, submit("x", "a", "1", "p2")),
        (4, Kill("A1")),
        (4.1, Operate("A2", "job_cancelled/x", True)),
        (8, revised(WITHOUT_P2, True)),
        (9, submit("y", "a", "2", "p1", robot="A2")),
        (12, Restart("A1")),
    )
    assert in_force(result) == {1}
    assert state_of(result, "y") == {"succeeded"}


# -- jobs -----------------------------------------------------------------------------------------

DOSES = """
mission: dosing
ends: never
local_tasks: {dose: {parameters: [p], work: 1}, look: {parameters: [p], work: 1}}
robot_types: {arm: {capabilities: {dose: 1}}, eye: {capabilities: {look: 1}}}
robots: {A1: arm, A2: arm, E1: eye}
global_tasks:
  dose: {parameters: [p], needs: {dose($p): {min: 1}}, exclusive: true}
  check: {parameters: [p], needs: {look($p): {min: 1}}}
jobs:
  give: {parameters: {p: [bed_1, bed_2]}, tree: {Sequence: [dose($p), check($p)]}}
  see: {parameters: {p: [bed_1]}, tree: check($p)}
tree: {Jobs: [give, see]}
"""


def doses(*changes: tuple[str, str]) -> str:
    text = DOSES
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return text


ANOTHER_BED = doses(("[bed_1, bed_2]", "[bed_1, bed_2, bed_3]"))
NO_GIVE = doses(
    ("  give: {parameters: {p: [bed_1, bed_2]}, tree: {Sequence: [dose($p), check($p)]}}\n", ""),
    ("[give, see]", "[see]"),
)
GIVEN = ((3.0, Operate("E1", "borrowed/E1", "at_once")), (3.5, submit("one", "give", "bed_1")))
RETURNED = (20.0, Operate("E1", "borrowed/E1", "returned"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "changed",
    [
        ANOTHER_BED,
        doses(("[bed_1, bed_2]", "[bed_0, bed_2, bed_1]")),
        doses(
            ("{p: [bed_1, bed_2]}", "{bed: [bed_1]}"),
            ("[dose($p), check", "[dose($bed), check"),
            (", check($p)]", ", check($bed)]"),
        ),
        doses(("give: {p", "give: {priority: 3, p"), ("Jobs: [give, see]", "Jobs: [see, give]")),
        doses(("[dose($p), check($p)]", "[dose($p), check($p), check($p)]")),
        doses(
            (
                "{Sequence: [dose($p), check($p)]}",
                "{Parallel: {success: all, children: [check($p), dose($p)]}}",
            )
        ),
        doses(("A1: arm, A2: arm", "A2: arm, A3: arm, A1: arm"), ("dose: 1}}", "dose: 0.5}}")),
    ],
    ids=["a value", "an order", "a name", "a priority", "a step", "a place in the tree", "robots"],
)
def test_a_step_of_an_open_job_stays_done(changed: str) -> None:
    result = run(DOSES, *GIVEN, (12, revised(changed)), RETURNED)
    assert in_force(result) == {1}
    assert count(result, "began")["dose(bed_1)"] == 1
    assert count(result)["look(bed_1)"] >= 1
    assert state_of(result, "one") == {"succeeded"}


OTHER_DOSE = doses(("{dose($p): {min: 1}}", "{dose($p): {min: 1, max: 2}}"))


@pytest.mark.parametrize("at_s", [5.2, 12.0], ids=["under way", "done"])
def test_an_exclusive_step_is_not_begun_again_unless_the_operator_says_so(at_s: float) -> None:
    slow = tuple(each.replace("work: 1}, look", "work: 6}, look") for each in (DOSES, OTHER_DOSE))
    for forced in (False, True):
        result = run(slow[0], *GIVEN, (at_s, revised(slow[1], forced)), RETURNED)
        assert in_force(result) == {0}
        assert count(result, "began")["dose(bed_1)"] == 1
        facts = next(iter(result.agents.values())).view.facts
        assert "--repeat-exclusive" in facts.index(Revisions).void_reason(1) or not forced
    again = run(slow[0], *GIVEN, (at_s, revised(slow[1], True, True)), RETURNED)
    assert in_force(again) == {1}
    assert count(again, "began")["dose(bed_1)"] > 1


def test_an_exclusive_step_that_was_removed_and_comes_back_is_not_begun_again() -> None:
    gone = doses(("[dose($p), check($p)]", "[check($p)]"))
    back = run(DOSES, *GIVEN, (12, revised(gone)), (14, revised(DOSES)), RETURNED)
    assert in_force(back) == {2}
    assert count(back, "began")["dose(bed_1)"] == 1
    other = run(DOSES, *GIVEN, (12, revised(gone)), (14, revised(OTHER_DOSE, True)), RETURNED)
    assert in_force(other) == {1}
    assert count(other, "began")["dose(bed_1)"] == 1


@pytest.mark.parametrize(
    "between",
    [NO_GIVE, doses(("[bed_1, bed_2]", "[bed_2]")), None],
    ids=["without its type", "without its value", "without jobs"],
)
def test_the_end_of_a_job_is_kept_by_its_id(between: str | None) -> None:
    none = DOSES[: DOSES.index("jobs:")] + "tree: {ForceSuccess: check(bed_9)}\n"
    result = run(
        DOSES,
        (3, submit("one", "give", "bed_1")),
        (12, revised(between or none)),
        *(((14, submit("one", "see", "bed_1")),) if between else ()),
        (16, revised(DOSES, True)),
        (18, submit("one", "give", "bed_1")),
    )
    assert in_force(result) == {2}
    assert count(result)["dose(bed_1)"] == 1
    assert state_of(result, "one") == {"succeeded"}


# -- attempts -------------------------------------------------------------------------------------

TRIES = doses(
    ("{Sequence: [dose($p), check($p)]}", "{RetryUntilSuccessful: {attempts: 3, do: check($p)}}"),
    ("{dose: {parameters: [p], work: 1}, look: {parameters: [p], work: 1}}",
     "{dose: {parameters: [p], work: 1}, look: {parameters: [p], work: 3}}"),
)  # fmt: skip


@pytest.mark.parametrize(
    ("attempts", "state", "begun"),
    [(5, "succeeded", 4), (2, "failed", 2), (3, "failed", 3)],
)
def test_attempts_that_are_used_up_stay_used_up(attempts: int, state: str, begun: int) -> None:
    """In the third attempt it has fewer: it has failed. With more it goes on."""
    failing = TRIES.replace("exclusive: true}", "exclusive: true, failure: paper}")
    failing = failing.replace("look($p): {min: 1}}", "look($p): {min: 1}}, failure: paper")
    changed = failing.replace("attempts: 3", f"attempts: {attempts}")
    at_s = 11.0 if attempts != 2 else 10.4
    result = run(
        failing, (3, submit("one", "give", "bed_1")), (at_s, revised(changed, True)), failures=3
    )
    assert in_force(result) == {1}
    assert state_of(result, "one") == {state}
    assert count(result, "began")["look(bed_1)"] in (begun, begun + 1)


# -- robots ---------------------------------------------------------------------------------------

WITHOUT_A3 = WITH_P2.replace("A2: A, A3: A}", "A2: A}").replace(", A3: p0}", "}")


@pytest.mark.parametrize(
    "faults",
    [
        (),
        ((5.0, Kill("A3")),),
        ((10.001, Kill("A3")),),
        ((5.0, Kill("A3")), (15.0, Restart("A3"))),
        ((5.0, Freeze("A3")), (20.0, Thaw("A3"))),
    ],
    ids=["alive", "dead", "dies of it", "comes back", "frozen"],
)
def test_a_robot_that_a_revision_removes_has_left(faults: tuple[tuple[float, Fault], ...]) -> None:
    result = run(WITH_P2, *faults, (10, revised(WITHOUT_A3, True, robot="A1")), seconds=30)
    observer, views = result.observer, [result.agents[robot].view for robot in ("A1", "A2")]
    assert {view.facts.in_force.number for view in views} == {1}
    assert observer.robot_state("A3") is State.LEFT
    assert [fault for fault in observer.record.major if fault.until_us is None] == []
    assert not any("dead" in each.text for each in headline(observer, [], 0))
    assert result.stops.get("A3") in (None, (0, "left"))


def test_a_mission_of_another_name_or_that_the_robots_cannot_do_is_refused() -> None:
    for changed, why in (
        (DOSES.replace("mission: dosing", "mission: other"), "it is the mission other"),
        (doses(("look($p): {min: 1}", "look($p): {min: 2}")), "cannot do check(bed_1)"),
        (doses(("A1: arm, A2: arm, E1: eye", "A1: arm, E1: eye")), "A2 is alive and would leave"),
    ):
        refused = run(DOSES, (5, revised(changed)), seconds=10)
        assert in_force(refused) == {0}, why
        facts = next(iter(refused.agents.values())).view.facts
        assert why in facts.index(Revisions).void_reason(1)
        assert "--force" in facts.index(Revisions).void_reason(1)
        forced = run(DOSES, (5, revised(changed, True)), seconds=10)
        assert in_force(forced) >= {1}


# -- deliberate bugs ------------------------------------------------------------------------------


def test_removed_parts_must_be_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numbering, "MAX_RETIRED", 0)
    with pytest.raises(AssertionError):
        test_an_exclusive_step_that_was_removed_and_comes_back_is_not_begun_again()


def test_ends_must_be_believed_whatever_types_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    def by_type(entry: Entry, mission: Mission, run: str) -> Record | None:
        if isinstance(entry.record, JobEnd) and entry.record.type not in mission.jobs:
            return None
        return believed(entry, mission, run)

    monkeypatch.setattr(team_facts, "believed", by_type)
    with pytest.raises(AssertionError):
        test_the_end_of_a_job_is_kept_by_its_id(NO_GIVE)
