"""The vehicle repair on six real processes, with and without faults."""

from __future__ import annotations

import pytest

from mrbt_mesh.drills.physical import spans
from tests.support.paper_run import (
    check_paper,
    go_on_as_in_the_paper,
    hold_for_the_paper,
)
from tests.support.team import Team

ROBOTS = {"A1", "A2", "B1", "B2", "C1", "C2"}


@pytest.mark.smoke
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


@pytest.mark.smoke
def test_a_frozen_robot_is_replaced_and_yields_when_it_thaws(team: Team) -> None:
    team.hold("replace_hw")
    team.up()
    victim = team.wait_for_event("replace_hw")
    robot, part = victim["robot"], victim["args"][0]
    team.mrbt("freeze", robot)
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
