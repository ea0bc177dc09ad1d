"""Robots' rows: everything by sign and word."""

from __future__ import annotations

from mrbt_mesh.sim import Kill, Lose
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.model.why import why_robot
from mrbt_mesh.views.terminal.robot_rows import (
    bar,
    capabilities_text,
    robot_text,
    trees_text,
    why_text,
)
from mrbt_mesh.views.terminal.team import ShownTeam
from tests.support.runs import run_example

SECOND = 1_000_000


def shown_at(until_s: float) -> ShownTeam:
    until_us = round(until_s * SECOND)
    schedule = [(7 * SECOND, Kill("A1")), (2 * SECOND, Lose("B1", "do_diagnosis"))]
    result = run_example("vehicle_repair", 1, expect=None, schedule=schedule, timeout_us=until_us)
    shown = ShownTeam(TeamView(result.observer))
    shown.update(until_us)
    return shown


def test_state_task_and_progress() -> None:
    shown = shown_at(13.0)
    rows = {robot: robot_text(robot, item, 2, 13.0).plain for robot, item in shown.robots.items()}
    assert rows["A1"].rstrip() == "A1 ✖ dead"
    beats = shown.observer.membership.peers["B2"].heartbeat
    assert beats is not None
    done = f"{beats.progress}% {bar(beats.progress)}"
    assert f"B2 ● do_diagnosis(5) for 1 s of 6 s {done}" in rows["B2"]
    assert rows["B1"].startswith("B1 ● ✘do_diagnosis: injected free: no")
    over = robot_text("B2", shown.robots["B2"], 2, 13.0, is_over=True)
    assert over.plain == "B2 ■ ended"


def test_what_is_lost_is_struck_out_and_said() -> None:
    text = capabilities_text(shown_at(13.0).robots["B1"])
    assert text.plain.startswith("B can ")
    assert "✘do_diagnosis (lost: injected)" in text.plain
    (struck,) = (span for span in text.spans if "strike" in str(span.style))
    assert text.plain[struck.start : struck.end] == "do_diagnosis"
    assert "replace_hw (" in text.plain


def test_what_is_not_there_yet() -> None:
    item = shown_at(13.0).robots["B2"] | {
        "lost": {"go(1)": "no map"},
        "pending": {"fly": "no server yet", "look": "no server yet"},
    }
    text = robot_text("B2", item, 2, 13.0).plain
    assert "✘go(1): no map cannot use fly, look now: no server yet" in text


def test_the_trees_of_a_robot() -> None:
    shown = shown_at(13.0)
    told = " ".join(trees_text(shown.robots["B2"]).plain.split())
    assert told == "T_i ▶ running T_A ✔ success T_G ▶ running T_Li ▶ running"
    assert trees_text(shown.robots["A1"]).plain == ""


def test_a_bar_is_as_full_as_it_is_told() -> None:
    assert [bar(n) for n in (0, 50, 100, 250)] == ["▱" * 8, "▰▰▰▰▱▱▱▱", "▰" * 8, "▰" * 8]


def test_a_takeover_is_known_by_both_robots() -> None:
    shown = shown_at(13.0)
    (fault,) = shown.faults
    explained = shown.takeover_of("A1")
    assert explained is not None
    assert explained is shown.takeover_of(fault["replacement"])
    assert "took over its" in why_text(explained).plain
    assert shown.takeover_of("C1") is None


def test_why_names_the_candidates_and_who_is_chosen() -> None:
    lines = why_text(why_robot(shown_at(13.0).observer, "B2")).plain.splitlines()
    assert lines[0].startswith("B2 does do_diagnosis(5) for diagnose_part(5)")
    assert lines[1] == "do_diagnosis(5)"
    chosen = [line for line in lines if line.startswith("  ✔ ")]
    assert len(chosen) == 1
    assert "B2" in chosen[0]
    assert any("A1" in line and "is dead" in line for line in lines)
