"""The figures of a recorded run, held against what the robots did, and against the observer."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.drills.physical import spans
from mrbt_mesh.observer.job_rows import JobRows
from mrbt_mesh.recording.folder import observer_file, robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import Kill, Restart, Schedule, SimulationResult, simulate
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.views.report.model import ReportedWork, RunParts, RunReport, WaitKind
from mrbt_mesh.views.report.page import report_html
from mrbt_mesh.views.report.recorded import report_recording, without
from mrbt_mesh.views.report.summaries import report_summary
from tests.support.depot import depot, worker
from tests.support.recorded import record_example

# How long an observer may learn of something later than it was, and each robot's tasks are few.
LATE_S = 0.05
FAULTS: dict[str, Schedule] = {
    "killed": [(12_500_000, Kill("A1"))],
    "back": [(6_000_000, Kill("A2")), (9_000_000, Restart("A2"))],
    "calm": [],
}


@pytest.fixture(scope="module", params=sorted(FAULTS))
def ran(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[SimulationResult, RunReport, Path]:
    folder = tmp_path_factory.mktemp("reported")
    result = record_example(folder, "vehicle_repair", 7, FAULTS[request.param])
    recording = read_recording(observer_file(folder))
    return result, report_recording(recording, "run"), folder


def physical(result: SimulationResult) -> dict[str, list[tuple[float, float]]]:
    """Robot -> when its program ran a local task, as it wrote itself; deaths end it."""
    deaths: dict[int, float] = {}
    record = result.observer.record
    start_s = (record.started_us or 0) / 1e6
    begin: dict[str, list[Any]] = defaultdict(list)
    for event in result.events:
        begin[event["robot"]].append(event)
    for takeover in result.summary["takeovers"]:
        last = [e for e in begin[takeover["robot"]] if e["t"] <= takeover["at_s"] + start_s + 0.1]
        if last:
            deaths[last[-1]["pid"]] = takeover["at_s"] + start_s
    found = defaultdict(list)
    for span in spans(result.events, deaths):
        found[span.robot].append((span.start_s - start_s, span.end_s - start_s))
    return found


@pytest.mark.slow
def test_utilisation_is_what_the_programs_did(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    result, report, _ = ran
    done = physical(result)
    assert sum(len(each) for each in done.values()) >= 20
    for robot in report.robots:
        worked_s = sum(end - begin for begin, end in done[robot.robot])
        assert robot.working_s == pytest.approx(worked_s, abs=LATE_S * (1 + len(done[robot.robot])))
        assert robot.utilisation is not None
        assert 0 < robot.utilisation <= 1
        assert robot.working_s + robot.starting_s <= robot.present_s + 1e-6
        assert robot.present_s <= report.duration_s + 1e-6


def test_the_bars_are_the_observers_work_log(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    _, report, folder = ran
    player = Player(read_recording(observer_file(folder)))
    player.seek(player.end_us)
    record = player.observer.record
    assert report.work == tuple(
        ReportedWork(
            span.robot,
            span.global_task,
            span.local_task,
            (span.claimed_us - (record.started_us or 0)) / 1e6,
            None if span.running_us is None else record.seconds(span.running_us),
            # What was told after the result is of no interest.
            min(record.seconds(span.ended_us) or 0.0, report.duration_s),
            str(span.end),
        )
        for span in record.work_log.spans
        if span.ended_us is not None
    )
    by_robot: dict[str, float] = defaultdict(float)
    for work in report.work or ():
        assert work.from_s >= by_robot[work.robot]
        by_robot[work.robot] = work.to_s


def test_the_result_is_the_summarys(ran: tuple[SimulationResult, RunReport, Path]) -> None:
    result, report, _ = ran
    assert report.result == result.summary["result"] == "success"
    assert report.duration_s == pytest.approx(result.summary["duration_s"], abs=LATE_S)
    assert {task.name: (task.status, list(task.robots)) for task in report.tasks} == {
        name: (task["status"], task["robots"])
        for name, task in result.summary["global_tasks"].items()
    }
    assert len(report.deaths) == len(result.summary["takeovers"])
    for fault, told in zip(report.deaths, result.summary["takeovers"], strict=True):
        assert fault.robot == told["robot"]
        assert fault.at_s == pytest.approx(told["at_s"], abs=LATE_S)
        assert (fault.held, fault.replacement) == (told["held"], told["replacement"])
        assert fault.detected_us == round(1e6 * told["detected_s"])
        assert fault.taken_over_us == round(1e6 * told["reassigned_s"])
        assert fault.exact
    assert [(fault.robot, fault.lost) for fault in report.faults] == [
        (each["robot"], tuple(each.get("local_tasks", ()))) for each in result.summary["faults"]
    ]


def test_idle_work_and_start_fill_a_robots_time(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    _, report, _ = ran
    for robot in report.robots:
        waited_s = sum(
            wait.seconds
            for wait in report.waits or ()
            if wait.who == robot.robot and wait.kind is WaitKind.IDLE
        )
        spent_s = robot.working_s + robot.starting_s + waited_s
        assert spent_s == pytest.approx(robot.present_s, abs=0.5)


def test_a_waiting_task_names_the_robots_that_are_busy(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    _, report, _ = ran
    waits = [wait for wait in report.waits or () if wait.kind is WaitKind.TASK]
    wait = next(each for each in waits if each.who == "diagnose_part(5)" and each.seconds > 1)
    assert wait.robots == ("A1", "A2", "B1", "B2")
    assert "busy with earlier requests" in wait.reason
    # None of them was done with what it had begun before that.
    first = {r: next(w for w in report.work or () if w.robot == r) for r in wait.robots}
    done = [work for work in first.values() if work.end == "done"]
    assert wait.to_s >= min(work.to_s for work in done) - LATE_S


def test_robots_of_a_healthy_team_differ_only_while_they_tell_one_another(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    _, report, _ = ran
    assert report.differences
    assert report.differing_s is not None
    assert report.differing_s < 0.1
    assert all(each.to_s > each.from_s and each.robots for each in report.differences)


def test_a_healthy_team_agrees_on_its_plans(
    ran: tuple[SimulationResult, RunReport, Path],
) -> None:
    _, report, _ = ran
    plans = report.plans or ()
    agreed = [plan for plan in plans if plan.agreed_s is not None]
    assert len(agreed) > len(plans) / 2
    for plan in agreed:
        assert plan.agreed_s is not None
        assert 0 <= plan.agreed_s - plan.from_s < LATE_S
        assert plan.agreed_s < plan.to_s
    # All work was begun under a plan on which all had agreed by then.
    for work in report.work or ():
        if work.running_s is not None:
            assert any(
                plan.agreed_s is not None and plan.agreed_s <= work.running_s + LATE_S
                for plan in plans
                if plan.to_s > work.from_s - LATE_S
            )


def test_a_bare_recording_does_not_know_when_a_robot_died(
    tmp_path: Path,
) -> None:
    record_example(tmp_path, "vehicle_repair", 7, FAULTS["killed"])
    for path in (observer_file(tmp_path), robot_file(tmp_path, "B1")):
        report = report_recording(read_recording(path), "run")
        (fault,) = report.deaths
        assert (fault.robot, fault.replacement) == ("A1", "B1")
        assert fault.exact is (path == observer_file(tmp_path)), "a robot sees no process end"
        assert "B1 (performance 1) has taken over" in fault.why
        assert "A1 (performance 1.5) is dead" in fault.why
    assert (report.plans, report.differences) == (None, None)
    assert report.notes[0].startswith("as B1 saw it")


@pytest.mark.parametrize(
    ("cut", "left"),
    [
        ([], [(0, 10)]),
        ([(2, 4)], [(0, 2), (4, 10)]),
        ([(2, 4), (3, 12)], [(0, 2)]),
        ([(4, 4)], [(0, 10)]),
        ([(-5, 20)], []),
    ],
)
def test_time_without_that_in_which_a_robot_was_away(
    cut: list[tuple[int, int]], left: list[tuple[int, int]]
) -> None:
    assert without([(0, 10)], cut) == left


def test_failures_are_told_with_their_reasons(tmp_path: Path) -> None:
    """From the recording, and the same from the summary alone."""
    result = record_example(tmp_path, "tool_search", 1, [])
    report = report_recording(read_recording(observer_file(tmp_path)), "run")
    assert {each.reason for each in report.failures} >= {"the large screwdriver does not fit"}
    assert report.failures == report_summary(result.summary, "run").failures
    assert "the large screwdriver does not fit" in report_html(RunParts((report,)))


def test_what_was_scheduled_is_held_against_what_was_done(tmp_path: Path) -> None:
    # When the robot dies nobody is on its way: how far one has come is not among the facts.
    rest = "{Parallel: {success: all, children: [scan_at(a), scan_at(b), lift_at(b)]}}"
    killed = [(5_000_000, Kill("R2"))]
    result = simulate(
        depot(f"Sequence: [lift_at(a), {rest}]"), worker(), seed=1, schedule=killed, record=tmp_path
    )
    report = report_recording(read_recording(observer_file(tmp_path)), "run")
    events = {e["activation"]: e for e in result.events if e["outcome"] == "success"}
    names = {each["global_task"] for each in events.values()}
    assert {each.name for each in report.scheduled} == names
    for each in report.scheduled:
        assert each.ended_s is not None
        if each.known_s > 4.5:  # by a schedule after the death
            assert each.robots == each.done_by
            assert "R2" not in each.robots
            assert each.ends_s == pytest.approx(each.ended_s, abs=0.2)
    assert any(each.known_s > 4.5 for each in report.scheduled)
    assert "Scheduled and done" in report_html(RunParts((report,)))


def test_jobs_are_told_as_they_were_done(tmp_path: Path) -> None:
    submits: Schedule = [
        (2_000_000, Operate("C1", "job/one", ["inspect", ["shelf_5"], 3, 0, 0, 0], "op")),
        (3_000_000, Operate("C1", "job/two", ["inspect", ["nowhere"], 0, 0, 0, 0], "op")),
        (25_000_000, Operate("C1", "job/zoo", ["deliver", ["shelf_2", "dock_1", "3"], 0, 0, 0, 0])),
    ]
    result = record_example(tmp_path, "deliveries", 3, submits, timeout_us=30_000_000)
    report = report_recording(read_recording(observer_file(tmp_path)), "run")
    rows = {row.id: row for row in JobRows().of(result.observer)}
    told = [(job.id, job.call, job.state, job.robots) for job in report.jobs]
    assert [each[:2] for each in told] == [
        ("one", "inspect(shelf_5)"),
        ("zoo", "deliver(shelf_2,dock_1,3)"),
    ]
    assert [each[2:] for each in told] == [(rows[n].state, rows[n].robots) for n in ("one", "zoo")]
    one, zoo = report.jobs
    assert (one.priority, one.state, zoo.ended_s) == (3, "succeeded", None)
    times = (one.submitted_s or 0, one.begun_s or 0, one.ended_s or 0)
    assert 1 < times[0] <= times[1] < times[2] < 25
