"""The vehicle repair on six real processes, with and without faults."""

from __future__ import annotations

import signal

import pytest

from mrbt_mesh.drills.physical import of, spans
from tests.processes.conftest import REPAIR, Team
from tests.support.account import check_order, check_paper

pytestmark = [pytest.mark.processes, pytest.mark.timeout(240)]

ROBOTS = {"A1", "A2", "B1", "B2", "C1", "C2"}


def test_without_a_fault_the_run_is_the_papers(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["result"] == "success"
    assert set(summary["robots"]) == ROBOTS
    assert summary["faults"] == summary["blocked"] == summary["takeovers"] == []
    assert summary["global_tasks"]["fix_hw(2)"]["status"] == "success"
    assert summary["global_tasks"]["remove_screws"]["robots"] == ["C1", "C2"]
    check_paper(spans(team.events()))


def test_an_a_killed_at_the_hardware_is_replaced_by_a_b(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    victim = team.wait_for_event("replace_hw")
    team.signal(victim["robot"], signal.SIGKILL)
    code, summary = team.end()
    assert code == 0, team.logs()
    work = spans(team.events())
    check_order(work)
    took_over = [s for s in of(work, "replace_hw", victim["args"][0]) if s.end == "success"]
    assert [s.robot[0] for s in took_over] == ["B"]
    (takeover,) = summary["takeovers"]
    assert takeover["robot"] == victim["robot"]
    assert takeover["replacement"] == took_over[0].robot
    assert 0 <= takeover["detected_s"] <= takeover["reassigned_s"]
    assert [fault["robot"] for fault in summary["faults"]] == [victim["robot"]]


@pytest.mark.slow
def test_both_a_and_one_b_killed_one_after_another(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    first = team.wait_for_event("do_diagnosis", robot="A1")
    team.signal(first["robot"], signal.SIGKILL)
    team.wait_for_event("replace_hw")
    team.signal("A2", signal.SIGKILL)
    team.wait_for_event("replace_wires")
    team.signal("B1", signal.SIGKILL)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert {t["robot"] for t in summary["takeovers"]} == {"A1", "A2", "B1"}
    check_order(spans(team.events()))


def test_without_a_second_c_the_cover_is_blocked_until_it_joins(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    team.wait_for_event("use_screwdriver", robot="C1")
    team.mrbt("kill", "C1")
    reason = "blocked: move_frame needs 2, 1 alive"
    status = team.wait_until(
        lambda: next((s for s in [team.status()] if s["blocked"]), None), "blocked"
    )
    assert status["blocked"] == [{"request": "remove_cover", "reason": reason}]
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
    team.up(REPAIR, "--speed", "2")
    victim = team.wait_for_event("replace_hw")
    robot, part = victim["robot"], victim["args"][0]
    team.signal(robot, signal.SIGSTOP)
    replacement = team.wait_until(
        lambda: [
            e
            for e in team.events()
            if e["activation"] == victim["activation"] and e["robot"] != robot
        ],
        "a replacement",
    )[0]
    team.wait_for_event("replace_hw", "end", robot=replacement["robot"], args=[part])
    team.mrbt("thaw", robot)
    team.wait_for_event("replace_hw", "cancel", robot=robot)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert any(line["event"] == "fenced" for line in team.log(robot))
    ends = [e for e in team.events() if e["activation"] == victim["activation"]]
    assert [e["robot"] for e in ends if e["outcome"] == "success"] == [replacement["robot"]]
    assert summary["robots"][robot]["state"] == "alive"


def test_a_robot_that_leaves_hands_its_work_over(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    victim = team.wait_for_event("replace_hw")
    team.signal(victim["robot"], signal.SIGTERM)
    code, summary = team.end()
    assert code == 0, team.logs()
    assert summary["robots"][victim["robot"]]["state"] == "left"
    assert summary["takeovers"] == summary["faults"] == []
    done = [s for s in of(spans(team.events()), "replace_hw") if s.end == "success"]
    assert len(done) == 2


def test_minor_fault_and_restore(team: Team) -> None:
    team.up(REPAIR, "--speed", "2")
    victim = team.wait_for_event("do_diagnosis", robot="B1")
    told = team.mrbt("fault", "B1", "--lose", "do_diagnosis")
    assert "B1 has lost do_diagnosis" in told
    team.wait_for_event("do_diagnosis", "cancel", robot="B1")
    assert team.status()["robots"]["B1"]["lost"] == ["do_diagnosis"]
    assert "B1 has lost nothing" in team.mrbt("restore", "B1")
    wrong = team.command("fault", "B1", "--lose", "move_frame")
    assert wrong.returncode == 1
    assert "B1 has no local task 'move_frame'" in wrong.stderr
    code, summary = team.end()
    assert code == 0, team.logs()
    fault = next(f for f in summary["faults"] if f["kind"] == "minor")
    assert (fault["robot"], fault["local_tasks"]) == ("B1", ["do_diagnosis"])
    assert victim["activation"] in {
        e["activation"] for e in team.events() if e["outcome"] == "success"
    }
