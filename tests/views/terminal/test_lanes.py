"""The timeline's text, from items made by hand and from simulated runs."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.sim import Kill, Lose
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.terminal.lanes import Window, axis, lane, latest_fault
from mrbt_mesh.views.terminal.team import ShownTeam
from tests.support.runs import run_example
from tests.support.watched import ALONE, watched

SECOND = 1_000_000
TEN = Window(0.0, 10.0, 40)


def work(robot: str, task: str, *times_s: float | None, end: str | None = None) -> dict[str, Any]:
    claimed_s, running_s, ended_s = times_s
    return {
        "robot": robot,
        "global_task": task,
        "local_task": task,
        "claimed_s": claimed_s,
        "running_s": running_s,
        "ended_s": ended_s,
        "end": end,
    }


def fault(robot: str, at_s: float, until_s: float | None = None, **more: Any) -> dict[str, Any]:
    empty = dict.fromkeys(("detected_ms", "taken_over_ms", "replacement", "held"))
    return {"robot": robot, "at_s": at_s, "until_s": until_s, **empty, **more}


def past(**items: dict[str, Any]) -> ShownTeam:
    found = ShownTeam(TeamView(watched(ALONE)[1]))
    found.take({key.replace("_", "/"): item for key, item in items.items()})
    return found


def drawn(found: ShownTeam, robot: str, now_s: float = 10.0, window: Window = TEN) -> str:
    found.now_s = now_s
    return lane(found, robot, window).plain


def test_a_block_tells_what_was_claimed_done_and_how_it_ended() -> None:
    found = past(
        work_0=work("A", "weld", 1.0, 2.0, 4.0, end="done"),
        work_1=work("A", "carry", 4.0, None, 6.0, end="dropped"),
        work_2=work("A", "paint", 6.0, 6.0, None),
    )
    assert drawn(found, "A") == "    ┣weld━━━━━━✔┣carry┄┤┣paint━━━━━━━━━▶"
    assert drawn(found, "B") == " " * 40


def test_what_is_claimed_and_not_begun_is_dotted() -> None:
    found = past(work_0=work("A", "a_long_name", 0.0, 2.0, 4.0, end="failed"))
    wide = Window(0.0, 10.0, 60)
    assert drawn(found, "A", window=wide).rstrip() == "┣a_long_name━━━━━━━━━━━✘"
    short = past(work_0=work("A", "a_long_name", 0.0, 1.0, 2.0, end="done"))
    assert drawn(short, "A").rstrip() == "┣a_lon…✔"


def test_a_death_a_takeover_and_a_return() -> None:
    found = past(
        work_0=work("A", "weld", 0.0, 0.0, 5.0, end="died"),
        work_1=work("B", "weld", 5.5, 6.0, None),
        fault_0=fault("A", 5.0, 8.0, replacement="B", taken_over_ms=500.0),
    )
    assert drawn(found, "A") == "┣weld━━━━━━━━━━━━━━━✖···········        "
    assert drawn(found, "B") == " " * 22 + "↳weld━━━━━━━━━━━━▶"


def test_a_loss_is_marked() -> None:
    lost = {"robot": "A", "local_tasks": ["weld"], "at_s": 2.5, "until_s": None}
    assert drawn(past(loss_0=lost), "A") == " " * 10 + "▾" + " " * 29


def test_what_lies_outside_is_cut() -> None:
    found = past(work_0=work("A", "weld", 0.0, 0.0, 20.0, end="done"))
    inside = drawn(found, "A", 30.0, Window(5.0, 10.0, 20))
    assert inside == "━weld━━━━━━━━━━━━━━━"
    assert drawn(found, "A", 30.0, Window(21.0, 30.0, 20)) == " " * 20


MOMENTS = st.floats(0.0, 100.0)


@given(st.tuples(MOMENTS, MOMENTS, MOMENTS), MOMENTS, st.floats(0.1, 50.0), st.integers(1, 90))
def test_a_lane_is_as_wide_as_it_is_told(
    times_s: tuple[float, float, float], from_s: float, span_s: float, width: int
) -> None:
    first, second, third = sorted(times_s)
    found = past(
        work_0=work("A", "weld", first, second, third, end="done"), fault_0=fault("A", second)
    )
    window = Window(from_s, from_s + span_s, width)
    assert len(drawn(found, "A", 100.0, window)) == width
    assert len(axis(window).plain) == width


@pytest.mark.parametrize(
    ("window", "labels"),
    [
        (Window(0.0, 10.0, 60), ["0 s", "2 s", "4 s", "6 s", "8 s"]),
        (Window(100.0, 160.0, 60), ["100 s", "110 s", "120 s", "130 s", "140 s", "150 s"]),
        (Window(0.0, 1.0, 50), ["0 s", "0.2 s", "0.4 s", "0.6 s", "0.8 s"]),
    ],
)
def test_the_axis_has_round_seconds(window: Window, labels: list[str]) -> None:
    told = axis(window).plain
    assert [label.strip() for label in told.split("╵")[1:]] == labels
    assert told[0] == "╵", "the mark stands at the moment that it names"


def test_a_run_is_drawn_as_it_was() -> None:
    result = run_example(
        "vehicle_repair", 1, schedule=[(7 * SECOND, Kill("A1")), (2 * SECOND, Lose("B1", "solder"))]
    )
    record = result.observer.record
    now_s = record.seconds(record.ended_us) or 0.0
    found = ShownTeam(TeamView(result.observer))
    found.update(record.ended_us or 0)
    (death,) = found.faults
    assert latest_fault(found).startswith("✖ A1 at ")
    assert f"{death['replacement']} took over after " in latest_fault(found)
    window = Window(0.0, now_s, 400)
    dead = drawn(found, "A1", now_s, window)
    assert dead.index("✖") == window.column(death["at_s"])
    assert dead.endswith("·")
    replaced = drawn(found, death["replacement"], now_s, window)
    assert "↳" in replaced
    for robot in result.observer.robots():
        done = [w for w in found.works(robot, 0.0) if w["end"] == "done"]
        assert drawn(found, robot, now_s, window).count("✔") == len(done)


def test_what_a_recording_has_of_later_times_is_not_drawn_yet() -> None:
    found = past(
        work_0=work("A", "weld", 0.0, 1.0, 8.0, end="died"),
        work_1=work("B", "weld", 9.0, 9.0, None),
        fault_0=fault("A", 8.0),
    )
    assert drawn(found, "A", 5.0).rstrip() == "┣weld━━━━━━━━━━━━━━▶"
    assert drawn(found, "B", 5.0).rstrip() == ""
    assert latest_fault(found) == ""


def test_what_is_expected_is_drawn_after_the_line_of_the_present() -> None:
    step = {"begins_s": 5.0, "ends_s": 8.0, "local_task": "lift"}
    robots = {"A": {"work": "weld", "work_s": 2.0, "steps": [step]}}
    found = past(
        work_0=work("A", "weld", 0.0, 0.0, None),
        forecast={"at_s": 1.0, "ends_s": 8.5, "robots": robots},
    )
    assert drawn(found, "A", 2.0) == "┣weld━━▶│╌╌╌            ├lift╌╌╌╌╌╌╌  ┊ "
    assert drawn(found, "B", 2.0) == "        │                             ┊ "
    assert found.expected_end_s == 9.5
