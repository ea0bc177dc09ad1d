"""The vehicle repair on six real processes, with and without faults."""

from __future__ import annotations

import signal

import pytest

from mrbt_mesh.drills.physical import of, spans
from tests.support.paper_run import (
    check_order,
    check_paper,
    go_on_as_in_the_paper,
    hold_for_the_paper,
)
from tests.support.team import TEST_TIMEOUT_S, Team

pytestmark = [pytest.mark.processes, pytest.mark.timeout(TEST_TIMEOUT_S)]

ROBOTS = {"A1", "A2", "B1", "B2", "C1", "C2"}


def test_without_a_fault_the_run_is_the_papers(team: Team) -> None:
    hold_for_the_paper(team)
    team.up()
    go_on_as_in_the_paper(team)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    assert set(summary["robots"]) == ROBOTS
    assert summary["faults"] == summary["blocked"] == summary["takeovers"] == []
    assert summary["global_tasks"]["fix_hw(2)"]["status"] == "success"
    assert summary["global_tasks"]["remove_screws"]["robots"] == ["C1", "C2"]
    check_paper(spans(team.events()))


def test_an_a_killed_at_the_hardware_is_replaced_by_a_b(team: Team) -> None:
    team.hold("replace_hw")
    team.up()
    victim = team.wait_for_work(team.wait_for_event("replace_hw"))
    team.signal(victim["robot"], signal.SIGKILL)
    replacement = team.wait_for_work(team.wait_for_replacement(victim))
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    work = spans(team.events())
    check_order(work)
    took_over = [s for s in of(work, "replace_hw", victim["args"][0]) if s.end == "success"]
    assert [s.robot for s in took_over] == [replacement["robot"]]
    assert replacement["robot"][0] == "B"
    (takeover,) = summary["takeovers"]
    assert takeover["robot"] == victim["robot"]
    assert takeover["replacement"] == replacement["robot"]
    assert 0 <= takeover["detected_s"] <= takeover["reassigned_s"]
    assert [fault["robot"] for fault in summary["faults"]] == [victim["robot"]]


@pytest.mark.slow
def test_both_a_and_one_b_killed_one_after_another(team: Team) -> None:
    team.hold("do_diagnosis")
    team.up()
    for robot, local_task, following in (
        ("A1", "do_diagnosis", "replace_hw"),
        ("A2", "replace_hw", "replace_wires"),
        ("B1", "replace_wires", "place_cover"),
    ):
        team.wait_for_work(team.wait_for_event(local_task, robot=robot))
        team.signal(robot, signal.SIGKILL)
        team.wait_for_line(f"{robot} is dead")
        team.hold(following)
        team.release(local_task)
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert {t["robot"] for t in summary["takeovers"]} == {"A1", "A2", "B1"}
    check_order(spans(team.events()))


def test_without_a_second_c_the_cover_is_blocked_until_it_joins(team: Team) -> None:
    team.hold("use_screwdriver")
    team.up()
    team.wait_for_events(2, "use_screwdriver")
    team.mrbt("kill", "C1")
    team.wait_for_line("C1 is dead")
    team.release()
    reason = "blocked: move_frame needs 2, 1 alive"
    team.wait_for_line(f"remove_cover {reason}")
    expected = [{"request": "remove_cover", "reason": reason}]
    status = team.wait_until(
        lambda: next((s for s in [team.status()] if s["blocked"] == expected), None), expected
    )
    assert status["robots"]["C1"] == status["robots"]["C1"] | {"state": "dead", "pid": None}
    assert status["agreement"] is True
    team.mrbt("join", "C1")
    code, summary = team.end()
    assert code == 0, team.logs()
    (episode,) = summary["blocked"]
    assert (episode["request"], episode["reason"]) == ("remove_cover", reason)
    assert 0 <= episode["from"] < episode["to"] <= summary["duration_s"]
    assert {event["robot"] for event in team.events()} == ROBOTS


def test_a_frozen_robot_is_replaced_and_yields_when_it_thaws(team: Team) -> None:
    team.hold("replace_hw")
    team.up()
    victim = team.wait_for_event("replace_hw")
    robot, part = victim["robot"], victim["args"][0]
    team.signal(robot, signal.SIGSTOP)
    replacement = team.wait_for_replacement(victim)
    team.hold("replace_wires")
    team.release("replace_hw")
    team.wait_for_event("replace_hw", "end", robot=replacement["robot"], args=[part])
    team.mrbt("thaw", robot)
    team.wait_for_event("replace_hw", "cancel", robot=robot)
    team.wait_for_line(f"{robot} is back")
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert any(line["event"] == "fenced" for line in team.log(robot))
    ends = [e for e in team.events() if e["activation"] == victim["activation"]]
    assert [e["robot"] for e in ends if e["outcome"] == "success"] == [replacement["robot"]]
    assert summary["robots"][robot]["state"] == "alive"


def test_a_robot_that_leaves_hands_its_work_over(team: Team) -> None:
    team.hold("replace_hw")
    team.up()
    victim = team.wait_for_event("replace_hw")
    team.signal(victim["robot"], signal.SIGTERM)
    team.wait_for_replacement(victim)
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["robots"][victim["robot"]]["state"] == "left"
    assert summary["takeovers"] == summary["faults"] == []
    done = [s for s in of(spans(team.events()), "replace_hw") if s.end == "success"]
    assert len(done) == 2


def test_minor_fault_and_restore(team: Team) -> None:
    team.hold("do_diagnosis")
    team.up()
    victim = team.wait_for_event("do_diagnosis", robot="B1")
    told = team.mrbt("fault", "B1", "do_diagnosis")
    assert "B1 has lost do_diagnosis" in told
    team.wait_for_event("do_diagnosis", "cancel", robot="B1")
    assert team.status()["robots"]["B1"]["lost"] == {"do_diagnosis": "operator"}
    team.wait_for_line("B1 lost do_diagnosis: operator")
    assert "B1 has lost nothing" in team.mrbt("fault", "B1", "all", "--end")
    wrong = team.command("fault", "B1", "move_frame")
    assert wrong.returncode == 1
    assert "B1 has no local task 'move_frame'" in wrong.stderr
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    fault = next(f for f in summary["faults"] if f["kind"] == "minor")
    assert (fault["robot"], fault["local_tasks"]) == ("B1", ["do_diagnosis"])
    assert victim["activation"] in {
        e["activation"] for e in team.events() if e["outcome"] == "success"
    }
