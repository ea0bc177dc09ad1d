"""What operators do to a team in virtual time: jobs, revisions, borrowing, pauses."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest

from mrbt_mesh import InputError, RobotProgram, TaskContext
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.testing import (
    AbortMission,
    Borrow,
    CancelJob,
    Command,
    HoldJob,
    Kill,
    Leave,
    Lose,
    MissionRun,
    PauseTeam,
    ReleaseJob,
    Restart,
    ResumeTeam,
    Return,
    ReviseMission,
    RunMission,
    SetPriority,
    Submit,
    run,
)
from tests.support.paths import ROOT, mission_file

FILE = """
mission: depot
ends: never
blackboard: {weight: {min: 0, max: 100, per: job}}
local_tasks:
  take: {parameters: [what], work: 2, sets: [weight]}
  look: {parameters: [where], work: 1}
robot_types:
  cart: {capabilities: {take: 1}}
  scout: {capabilities: {look: 1}}
robots: {C1: cart, C2: cart, S1: scout}
global_tasks:
  fetch: {parameters: [what], needs: {take($what): {min: 1}}}
  check: {parameters: [where], needs: {look($where): {min: 1}}}
jobs:
  deliver:
    parameters: {what: {min: 1, max: 9}, where: [dock_1, dock_2]}
    deadline_s: 300
    tree: {Sequence: [fetch($what), check($where)]}
  inspect:
    parameters: {where: [dock_1, dock_2]}
    priority: 5
    tree: check($where)
tree: {Jobs: [deliver, inspect]}
"""
MORE = FILE.replace("S1: scout", "S1: scout, S2: scout").replace(
    "tree: {Jobs: [deliver, inspect]}",
    "  patrol: {tree: {Sequence: [check(dock_1), check(dock_2)]}}\n"
    "tree: {Jobs: [deliver, inspect, patrol]}",
)


def mission(text: str = FILE) -> Mission:
    return mission_from_yaml(text, "m.yaml", Path())


def robot() -> RobotProgram:
    program = RobotProgram()

    @program.local_task("*")
    async def anything(task: TaskContext, *_: str) -> None:
        await anyio.sleep(task.simulation.duration_s)
        if task.local_task.startswith("take"):
            task.set_value("weight", 12)

    return program


def given(*commands: tuple[float, Command], **more: Any) -> MissionRun:
    """A run until all jobs have ended, if there are any."""
    has_jobs = any(isinstance(each, tuple) and isinstance(each[1], Submit) for each in commands)
    options = {"until_jobs_end": has_jobs, "timeout_s": 120} | more
    return run(mission(), robot(), commands=commands, **options)


def test_a_job_that_is_done() -> None:
    found = given((2.0, Submit("deliver", [7, "dock_1"])))
    (job,) = found.jobs
    assert found.job("job-1") == job
    assert (job.id, job.type, job.state, job.why) == ("job-1", "deliver", "succeeded", "")
    assert job.arguments == {"what": 7, "where": "dock_1"}
    assert (job.attempts, job.results) == (1, {"weight": "12"})
    assert job.robots == (*found.succeeded("take(7)"), "S1")
    assert job.submitted_s == 2.0
    assert job.begun_s == pytest.approx(2.0, abs=0.5)
    assert job.ended_s == pytest.approx(job.begun_s + 3, abs=0.5)
    assert found.whole.duration_us / 1e6 == pytest.approx(job.ended_s, abs=0.5)
    assert found.refused == []


def test_arguments_by_name_and_a_command_before_the_team_has_gathered() -> None:
    found = given((0, Submit("deliver", {"where": "dock_2", "what": "7"}, "mine")))
    assert found.job("mine").state == "succeeded"
    assert found.job("mine").submitted_s > 0
    assert found.job("mine").arguments == {"what": 7, "where": "dock_2"}


def test_the_same_again() -> None:
    once, again = (given((2.0, Submit("deliver", [7, "dock_1"])), seed=3) for _ in range(2))
    assert once.jobs == again.jobs
    assert once.starts == again.starts
    assert once.whole.effect_log_digest == again.whole.effect_log_digest


def test_jobs_have_ids_in_the_order_in_which_they_are_listed() -> None:
    look = Submit("inspect", ["dock_1"])
    found = given((5, look), (2, look), (3, replace(look, id="job-1")), (2, look))
    assert [(job.id, job.submitted_s) for job in found.jobs] == [
        ("job-3", 2),
        ("job-4", 2),
        ("job-1", 3),
        ("job-2", 5),
    ]


def test_jobs_that_expire_or_begin_later() -> None:
    found = given(
        (2, Submit("deliver", [1, "dock_1"], deadline_s=1.0)),
        (2, Submit("inspect", ["dock_1"], not_before_s=20)),
        (2, Submit("deliver", [2, "dock_1"], "usual", not_before_s=40)),
    )
    late = found.job("job-1")
    assert (late.state, late.ended_s) == ("expired", pytest.approx(3, abs=0.3))
    assert found.job("job-2").begun_s == pytest.approx(22, abs=0.5)
    assert found.job("usual").state == "succeeded"
    assert found.cancelled("take")


def test_a_job_that_waits_when_the_run_ends() -> None:
    found = given((2, Submit("inspect", ["dock_1"], not_before_s=200)))
    assert found.job("job-1").state == "waiting"
    assert (found.job("job-1").begun_s, found.job("job-1").ended_s) == (None, None)
    assert found.job("job-1").why.startswith("not before")


def test_a_job_that_is_cancelled() -> None:
    found = given((2, Submit("deliver", [1, "dock_1"])), (3, CancelJob("job-1")))
    assert (found.job("job-1").state, found.job("job-1").ended_s) == ("cancelled", 3)
    assert found.cancelled("take(1)")
    assert not found.started("look")


@pytest.mark.parametrize("now", [False, True])
def test_a_job_that_is_held_and_released(now: bool) -> None:
    found = given(
        (2, Submit("deliver", [1, "dock_1"])), (3, HoldJob("job-1", now)), (20, ReleaseJob("job-1"))
    )
    assert found.job("job-1").state == "succeeded"
    assert bool(found.cancelled("take(1)")) is now
    assert next(e.at_s for e in found.starts if e.local_task == "look(dock_1)") > 20


def test_a_larger_priority_goes_first() -> None:
    jobs = [(2.0, Submit("inspect", ["dock_1"])) for _ in range(3)]
    last = (2.1, Submit("inspect", ["dock_1"], priority=7)), (2.1, SetPriority("job-3", 9))
    found = given(*jobs, *last)
    order = sorted(found.jobs, key=lambda job: job.ended_s or 0)
    assert [job.id for job in order] == ["job-1", "job-3", "job-4", "job-2"]


def test_a_job_is_taken_over_from_a_robot_that_dies_at_work() -> None:
    job = (2.0, Submit("deliver", [1, "dock_1"]))
    (worker,) = given(job).succeeded("take(1)")
    (other,) = {"C1", "C2"} - {worker}
    found = given(job, faults=[(3.0, Kill(worker))])
    assert found.job("job-1").state == "succeeded"
    assert found.job("job-1").robots == ("C1", "C2", "S1")
    assert found.started("take(1)") == [worker, other]


def test_what_the_team_refuses_fails_the_test() -> None:
    commands: tuple[tuple[float, Command], ...] = (
        (2, Submit("inspect", ["dock_1"], "one")),
        (2.5, Submit("inspect", ["dock_2"], "one")),
        (9, CancelJob("one")),
    )
    with pytest.raises(AssertionError) as caught:
        given(*commands)
    there, ended = str(caught.value).splitlines()
    assert re.match(r"commands\[1\]: Submit\(type='inspect', .* at 2.5 s: there is another", there)
    assert ended == "commands[2]: CancelJob(id='one') at 9 s: one has ended: succeeded"
    found = given(*commands, may_refuse=True)
    assert [(each.at_s, each.command) for each in found.refused] == [
        (2.5, commands[1][1]),
        (9, commands[2][1]),
    ]
    assert found.refused[1].reason == "one has ended: succeeded"
    assert [job.id for job in found.jobs] == ["one"]


def test_a_team_of_which_too_few_or_none_live_takes_no_job() -> None:
    dead = [(1.0, Kill(each)) for each in ("C1", "C2", "S1")]
    submit = (2.0, Submit("inspect", ["dock_1"]))
    with pytest.raises(AssertionError, match="no robot of the team is heard"):
        given(submit, (30.0, PauseTeam()), faults=[*dead, (60, Restart("C1"))])
    text = "nothing was written: S1 would take it, and 2 robots are needed"
    with pytest.raises(AssertionError, match=text):
        given((20.0, submit[1]), faults=dead[:2])
    found = given((20.0, submit[1]), faults=dead[:2], may_refuse=True)
    with pytest.raises(InputError, match=f"taken no job 'job-1': {text}"):
        found.job("job-1")
    # As a client does, it is given again for some seconds.
    found = given(submit, faults=[*dead, (5, Restart("C1")), (5, Restart("S1"))])
    assert found.job("job-1").state == "succeeded"
    assert 5 < found.job("job-1").submitted_s < 12


def test_a_command_after_the_end_and_one_without_an_answer() -> None:
    abort = (3, AbortMission())
    with pytest.raises(InputError, match=r"commands.1.: PauseTeam.* the run had ended before, at"):
        given(abort, (20, PauseTeam()))
    with pytest.raises(AssertionError, match="C1 does not answer, and the run ended"):
        given((2.5, Borrow("C1")), faults=[(1, Kill("C1"))], timeout_s=5)


def test_a_revision_with_a_type_and_a_robot(tmp_path: Path) -> None:
    (tmp_path / "more.yaml").write_text(MORE, encoding="utf-8")
    found = given(
        (2, Submit("inspect", ["dock_1"])),
        (8, ReviseMission(tmp_path / "more.yaml")),
        (10, Submit("patrol")),
        (20, Submit("inspect", ["dock_1"])),
        (20, Submit("inspect", ["dock_2"])),
        faults=[(12, Restart("S2")), (20, Lose("S2", "look(dock_1)")), (40, Leave("S2"))],
    )
    assert [(job.type, job.state) for job in found.jobs] == [
        ("inspect", "succeeded"),
        ("patrol", "succeeded"),
        ("inspect", "succeeded"),
        ("inspect", "succeeded"),
    ]
    assert "S2" in found.started("look")
    assert found.whole.observer.mission.number == 1


def test_a_revision_that_is_refused_and_what_relies_on_it() -> None:
    less = mission(FILE.replace("C2: cart, ", ""))
    with pytest.raises(AssertionError, match=r"commands\[0\]: .*C2 is alive and would leave: keep"):
        given((3, ReviseMission(less)))
    assert given((3, ReviseMission(less, force=True))).whole.stops["C2"] == (0, "left")
    other = mission(MORE.replace("mission: depot", "mission: other"))
    found = given(
        (3, ReviseMission(other)),
        (9, Submit("patrol")),
        faults=[(9, Restart("S2"))],
        may_refuse=True,
    )
    assert [(each.at_s, each.reason) for each in found.refused] == [
        (3, found.refused[0].reason),
        (9, "the mission in force has no robot S2"),
        (9, "no job type 'patrol'; known: deliver, inspect"),
    ]
    assert "give the right file or team, or use --force" in found.refused[0].reason
    assert found.refused[1].command == Restart("S2")


def test_a_revision_that_does_not_come_into_force_is_withdrawn() -> None:
    """With exclusive tasks it takes a majority of the robots."""
    text = FILE.replace("fetch: {", "fetch: {exclusive: true, ")
    more = mission(MORE.replace("fetch: {", "fetch: {exclusive: true, "))
    found = run(
        mission(text),
        robot(),
        commands=[(15, ReviseMission(more, force=True))],
        faults=[(1, Kill("C1")), (1, Kill("C2"))],
        timeout_s=60,
        may_refuse=True,
    )
    ((at_s, reason),) = [(each.at_s, each.reason) for each in found.refused]
    assert (at_s, reason) == (15, "not in force after 30 s, waited for a majority of the robots")
    revisions = found.whole.agents["S1"].view.facts.index(Revisions)
    assert revisions.void_reason(1) == "it was withdrawn"


def test_a_revision_that_no_team_could_take_up() -> None:
    wrong = mission(FILE.replace("weight: {min: 0, max: 100", "weight: {text: 8"))
    with pytest.raises(AssertionError, match="weight"):
        given((3, ReviseMission(wrong)))


def test_a_robot_is_borrowed_and_returned() -> None:
    job, later = Submit("inspect", ["dock_1"]), Submit("inspect", ["dock_2"])
    found = given((2, job), (2.5, Borrow("S1")), (20, Return("S1")), (30, later))
    assert found.cancelled("look(dock_1)") == ["S1"]
    assert found.job("job-1").ended_s == pytest.approx(21, abs=0.5)
    after = given((2, job), (2.5, Borrow("S1", after_task=True)), (20, Return("S1")), (3, later))
    assert after.cancelled() == []
    assert after.job("job-2").begun_s == pytest.approx(20, abs=0.5)
    with pytest.raises(AssertionError, match="C1 is not borrowed"):
        given((2, Return("C1")))


def test_a_pause() -> None:
    found = given((2, Submit("inspect", ["dock_1"])), (2.5, PauseTeam()), (30, ResumeTeam()))
    assert found.job("job-1").state == "succeeded"
    assert found.job("job-1").ended_s > 30


def test_a_job_says_that_it_waits_for_the_end_of_a_pause() -> None:
    found = given((2, PauseTeam()), (3, Submit("inspect", ["dock_1"])), timeout_s=20)
    assert (found.job("job-1").state, found.job("job-1").why) == ("waiting", "the team is paused")


def test_an_abort_cancels_open_jobs() -> None:
    found = given(
        (2, Submit("inspect", ["dock_1"])),
        (4, Submit("deliver", [1, "dock_1"])),
        (5, AbortMission()),
        until_jobs_end=False,
    )
    assert found.result == "failure"
    assert [(job.state, job.why) for job in found.jobs] == [
        ("succeeded", ""),
        ("cancelled", "the mission was aborted"),
    ]
    assert found.cancelled("take(1)")
    cancelled = found.jobs[1]
    assert (cancelled.ended_s, len(cancelled.robots)) == (5, 1)
    told = found.whole.summary["jobs"]["deliver"]
    assert told["robots"] == {cancelled.robots[0]: 1}
    assert told["worked_s"]["mean"] == pytest.approx(1, abs=0.2)


def test_all_robots_that_worked_on_a_job_count() -> None:
    """Also one that a cancellation stops, and those of steps before."""
    found = given(
        (2, Submit("deliver", [1, "dock_1"])),
        (4.5, CancelJob("job-1")),
        (5, Submit("deliver", [2, "dock_1"])),
        (6, CancelJob("job-2")),
    )
    first, second = found.jobs
    assert [job.state for job in found.jobs] == ["cancelled", "cancelled"]
    assert first.robots == (*found.succeeded("take(1)"), "S1")
    assert len(second.robots) == 1
    robots = found.whole.summary["jobs"]["deliver"]["robots"]
    assert (sum(robots.values()), robots["S1"]) == (3, 1)


def test_names_of_local_tasks_in_jobs() -> None:
    found = given((2, Submit("deliver", [1, "dock_1"])))
    assert found.started("take(2)") == []
    for wrong in ("take(10)", "look(dock_3)", "take(1,2)"):
        with pytest.raises(InputError, match=f"no local task {re.escape(repr(wrong))}"):
            found.started(wrong)
    with pytest.raises(InputError, match=r"has taken no job 'job-2'; did you mean 'job-1'"):
        found.job("job-2")


JOB = Submit("inspect", ["dock_1"], "one")


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ((1, Kill("C1")), r"\(seconds, command\) is expected, e.g. "),
        (PauseTeam(), r"\(seconds, command\) is expected, e.g. "),
        (("1", PauseTeam()), "seconds: a number from 0 is expected, not '1'"),
        ((-1, PauseTeam()), "seconds: a number from 0 is expected, not -1"),
        ((900, PauseTeam()), ".* the run is given up at 120 s; give it a longer timeout"),
        ((1, Submit("inspct")), ".* no job type 'inspct'; did you mean 'inspect'"),
        ((1, Submit("inspect", ["dock_9"])), ".* where is one of dock_1, dock_2"),
        ((1, Submit("inspect", "dock_1")), ".* arguments are values in order, or by the names"),
        ((1, Submit("inspect")), ".* inspect takes 1 argument .where.; given: 0"),
        ((1, Submit("deliver", {"what": 1})), ".* deliver takes the arguments what, where; given"),
        ((1, replace(JOB, id="a b")), ".* 'a b' is not an id"),
        ((1, replace(JOB, priority=5_000)), ".* a priority is a whole number from"),
        ((1, replace(JOB, deadline_s=-1)), ".*deadline_s: a number from 0 is expected, not -1"),
        ((1, Submit("patrol")), ".* no job type 'patrol'; known: deliver, inspect"),
        ((1, CancelJob("on")), ".* no job 'on' is submitted; did you mean 'one'"),
        ((1, SetPriority("one", 5_000)), ".* a priority is a whole number from"),
        ((1, Borrow("C9")), ".* mission depot has no robot 'C9'"),
        ((1, Return("S2")), ".* mission depot has no robot 'S2'"),
        ((1, ReviseMission(3)), ".* a mission is a file, or what load_mission returns"),  # type: ignore[arg-type]
    ],
)
def test_what_does_not_fit_is_told(command: Any, message: str) -> None:
    revision = (60, ReviseMission(mission(MORE)))
    with pytest.raises(InputError, match=r"^commands\[2\]: " + message):
        given((70, JOB), revision, command)


def test_a_run_until_jobs_end_needs_a_job() -> None:
    with pytest.raises(InputError, match="until_jobs_end: no job is submitted; add a Submit"):
        given((3, PauseTeam()), until_jobs_end=True)


def test_a_robot_of_a_later_revision() -> None:
    with pytest.raises(InputError, match=r"faults.0.*mission depot has no robot 'S2'"):
        given((60, ReviseMission(mission(MORE))), (70, JOB), faults=[(30, Restart("S2"))])


def test_files_of_commands_lie_beside_the_test(run_mission: RunMission) -> None:
    with pytest.raises(InputError, match=re.escape(str(Path(__file__).parent / "none.yaml"))):
        run_mission("../examples/explore/mission.yaml", commands=[(1, ReviseMission("none.yaml"))])


def test_the_guide_s_example(run_mission: RunMission) -> None:
    text = (ROOT / "docs/how-to/testing.md").read_text(encoding="utf-8")
    (code,) = (
        each for each in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "Submit" in each
    )
    names: dict[str, Any] = {}
    exec(code, names)
    tests = [each for name, each in names.items() if name.startswith("test_")]
    assert tests

    def beside_the_example(file: str, **more: Any) -> MissionRun:
        return run(mission_file("deliveries").parent / file, **more)

    for test in tests:
        test(beside_the_example)
