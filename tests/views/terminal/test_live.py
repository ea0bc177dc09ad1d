"""The live view of a terminal, drawn from simulated runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from rich.console import Console, RenderableType

from mrbt_mesh.formats.mission_file import load_mission
from mrbt_mesh.recording.folder import robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.runtime.program_loader import load_program
from mrbt_mesh.sim import ChangePerformance, Kill, Lose, SimulationResult, simulate
from mrbt_mesh.views.terminal.live import LiveNotes, LiveView
from tests.support.paths import EXAMPLES
from tests.support.recorded import record_example

REPAIR = EXAMPLES / "vehicle_repair" / "mission.yaml"
SECOND = 1_000_000


def run(
    until_s: float, *schedule: tuple[int, Kill | Lose | ChangePerformance], path: Path = REPAIR
) -> SimulationResult:
    """The repair until a moment in the middle of it."""
    mission = load_mission(path)
    program = load_program(mission.program or "")
    timeout_us = round(until_s * SECOND)
    return simulate(mission, program, seed=1, schedule=schedule, timeout_us=timeout_us)


def drawn(view: RenderableType, height: int = 40, width: int = 140) -> str:
    console = Console(width=width, height=height, record=True, file=None, force_terminal=False)
    with console.capture() as captured:
        console.print(view)
    return captured.get()


def live(result: SimulationResult, until_s: float, height: int = 40, width: int = 140) -> str:
    frame = LiveView().render(result.observer, round(until_s * SECOND), (width, height))
    return drawn(frame, height, width)


def line_of(text: str, part: str) -> str:
    return next(line for line in text.splitlines() if part in line)


def test_the_live_view_shows_tree_robots_and_what_happened() -> None:
    text = live(run(8.0), 8.0)
    assert "vehicle_repair" in text
    assert "all agree" in text
    assert "✔ remove_cover" in text
    assert "▶ diagnose (Parallel 5/5)" in text
    assert "do_diagnosis(3)" in line_of(text, "B1 B")
    assert "alive" in line_of(text, "C1 C")
    assert "· fix (Parallel 5/5)" in text, "what does not run is folded"
    assert "solder" not in text
    assert "move_frame done" in text


def test_the_live_view_shows_a_warning_as_long_as_it_runs() -> None:
    result = run(8.0)
    notes = LiveNotes("90 robots are too many for this machine", "http://127.0.0.1:8000/")
    lines = drawn(LiveView().render(result.observer, 8 * SECOND, (140, 40), notes)).splitlines()
    assert "vehicle_repair" in lines[0]
    assert "page: http://127.0.0.1:8000/" in lines[1]
    assert "90 robots are too many for this machine" in lines[2]
    assert "robots are too many" not in live(result, 8.0)


def test_the_live_view_shows_faults_and_what_is_blocked() -> None:
    kill, lose = (1 * SECOND, Kill("C1")), (2 * SECOND, Lose("B1", "do_diagnosis"))
    text = live(run(8.0, kill, lose), 8.0)
    assert "dead" in line_of(text, "C1 C")
    assert "lost do_diagnosis: injected" in line_of(text, "B1 B")
    assert "remove_cover blocked: move_frame needs 2, 1 alive" in text
    assert "C1 is dead" in text


def test_the_live_view_fits_a_small_terminal() -> None:
    text = live(run(8.0), 8.0, height=24)
    assert len(text.splitlines()) <= 24
    assert "B2 B" in text


def test_the_live_view_has_a_timeline_with_faults() -> None:
    text = live(run(13.0, (7 * SECOND, Kill("A1"))), 13.0)
    title = next(i for i, line in enumerate(text.splitlines()) if "─ timeline" in line)
    assert "✖ A1 at 7.0 s: known +" in text.splitlines()[title]
    lanes = {line.split("│ ")[-1][:2]: line for line in text.splitlines()[title + 1 :][:6]}
    assert list(lanes) == ["A1", "A2", "B1", "B2", "C1", "C2"]
    assert "━✖···" in lanes["A1"]
    assert "┣move_f" in lanes["C1"]
    assert "╵10 s" in text


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (200, 70)])
def test_the_live_view_uses_the_window(width: int, height: int) -> None:
    text = live(run(13.0, (7 * SECOND, Kill("A1"))), 13.0, height, width)
    lines = text.splitlines()
    assert len(lines) == height
    assert {len(line) for line in lines} == {width}
    assert lines[-1].startswith("╰")
    assert all(f" {robot}" in text for robot in ("A1", "A2", "B1", "B2", "C1", "C2"))
    assert "more" not in text


def test_robots_that_do_not_fit_are_counted() -> None:
    text = live(run(8.0), 8.0, height=18)
    assert len(text.splitlines()) == 18
    assert "… 4 more" in text


def test_a_subtree_is_shown_with_its_own_name_and_its_childs_children() -> None:
    text = live(run(13.0), 13.0)
    below = text.splitlines()[text.splitlines().index(line_of(text, "fix_part(2)")) + 1]
    assert "Inverter" in below
    assert "✔ fix_part(1)" in text


def test_bids_failures_and_rounds_are_in_the_live_view() -> None:
    for example, until_s, wanted in (
        ("couriers/mission.yaml", 1.0, "K4: bids -2.8 for deliver(keys)"),
        ("tool_search/mission.yaml", 20.0, "no tools in storage 1"),
        ("vehicle_repair/standing_by.yaml", 3.0, "stands by, rounds: 0"),
        ("vehicle_repair/standing_by.yaml", 12.0, "running  round 1"),
        ("vehicle_repair/standing_by.yaml", 33.0, "running  round 2"),
        ("vehicle_repair/standing_by.yaml", 33.0, "round 1: success after 24.0 s"),
    ):
        assert wanted in live(run(until_s, path=EXAMPLES / example), until_s)


def test_the_live_view_shows_a_recording(tmp_path: Path) -> None:
    record_example(tmp_path, "vehicle_repair", 7, [(12_500_000, Kill("A1"))])
    player = Player(read_recording(robot_file(tmp_path, "B1")))
    player.seek(13_000_000)
    notes = LiveNotes(warning="paused")
    shown = drawn(LiveView().render(player.observer, player.now_us, (140, 40), notes))
    for wanted in ("vehicle_repair", "A1 ", "dead", "B1: replace_hw(2)", "paused"):
        assert wanted in shown
