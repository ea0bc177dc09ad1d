"""The screen without a terminal, by textual's pilot, over simulated runs and a recording."""

from __future__ import annotations

import asyncio
import functools
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Footer

from mrbt_mesh.drills.control import FAULTS as ROBOT_FAULTS
from mrbt_mesh.drills.control import TEAM_COMMANDS, CommandError, Control
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.recording.folder import robot_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from mrbt_mesh.sim import Kill, Lose
from mrbt_mesh.testing import Submit, run
from mrbt_mesh.views.model.team_view import TeamView
from mrbt_mesh.views.replay.shown_recording import ShownRecording
from mrbt_mesh.views.terminal.app import ReplayTop, TeamTop
from mrbt_mesh.views.terminal.panes import JobsPane, Lanes, RobotsPane, TimelinePane, TreePane
from tests.support.paths import mission_file
from tests.support.recorded import record_example
from tests.support.runs import run_example
from tests.support.watched import ALONE, watched

SECOND = 1_000_000
FAULTS = [(7 * SECOND, Kill("A1")), (2 * SECOND, Lose("B1", "do_diagnosis"))]
SMALL, LARGE = (80, 24), (160, 50)
NOT_ALL = tuple(line.replace("start A C", "start A") for line in ALONE)


@functools.cache
def observed() -> Observer:
    """The repair until 13 s; nobody changes it."""
    return run_example(
        "vehicle_repair", 1, expect=None, schedule=FAULTS, timeout_us=13 * SECOND
    ).observer


@asynccontextmanager
async def opened(
    size: tuple[int, int] = SMALL, control: Control | None = None, *notes: str
) -> AsyncIterator[tuple[TeamTop, Pilot[None]]]:
    # The simulator has an event loop of its own.
    observer = await asyncio.to_thread(observed)
    app = TeamTop(TeamView(observer), lambda: 13 * SECOND, control, lambda: notes)
    async with app.run_test(size=size) as pilot:
        await pilot.pause()
        await pilot.pause()
        yield app, pilot


def on_screen(app: TeamTop) -> list[str]:
    strips = app.screen._compositor.render_strips()
    return ["".join(segment.text for segment in strip) for strip in strips]


def line_of(app: TeamTop, part: str) -> str:
    return next(line for line in on_screen(app) if part in line)


@pytest.mark.parametrize("size", [SMALL, (120, 40), LARGE])
async def test_all_panes_are_on_screen(size: tuple[int, int]) -> None:
    async with opened(size=size) as (app, _):
        lines = on_screen(app)
        assert len(lines) == size[1]
        assert "vehicle_repair  13.0 s  ! 1 dead: A1, replaced by A2 after" in lines[0]
        head = " ".join(line.strip() for line in lines[:2])
        assert "! B1 lost do_diagnosis: injected  ✔ running  ✔ all 5" in head.replace("   ", "  ")
        assert "▾ ▶ Fallback  running" in line_of(app, "A1 ✖ dead")
        assert "✘do_diagnosis" in line_of(app, "B1 ● ")
        assert "✖ A1 at 7.0 s: detected after " in line_of(app, "timeline")
        assert "━✖···" in line_of(app, "›A1  ")
        for robot in ("A1", "A2", "B1", "B2", "C1", "C2"):
            assert sum(line[1:4] == f"{robot} " for line in lines) == 1, "a lane each"
        assert "q quit ? help / find i T_i" in lines[-1]


async def test_notes_and_what_happened() -> None:
    async with opened((160, 50), None, "90 robots are too many", "web: http://[::1]:80/") as (
        app,
        _,
    ):
        lines = on_screen(app)
        assert lines[0].rstrip().endswith("agree"), "the headline, and nothing that wraps behind it"
        assert [line.strip() for line in lines[1:3]] == [
            "90 robots are too many",
            "web: http://[::1]:80/",
        ]
        assert "─ what happened─" in line_of(app, "what happened")
        (last,) = (line for line in lines if app.shown.events[-1]["text"] in line)
        assert f"{app.shown.events[-1]['at_s']:.2f}" in last


async def test_a_small_window_has_two_lines_above_the_panes() -> None:
    notes = "in another terminal: mrbt kill B2", f"web: http://127.0.0.1:8000/?token={'x' * 60}"
    async with opened(SMALL, None, *notes) as (app, pilot):
        lines = on_screen(app)
        assert "13.0 s  ! 1 dead: A1" in lines[0]
        assert "in another terminal: mrbt kill B2  web: http://127.0.0.1:8000/" in lines[1]
        assert lines[1].rstrip().endswith("…")
        assert "─ robots─" in lines[2]
        await pilot.press("question_mark")
        assert "x" * 30 in "".join(on_screen(app)), "the help has them in full"


async def test_a_team_that_only_watches_has_no_commands() -> None:
    async with opened() as (app, pilot):
        assert "kill" not in on_screen(app)[-1]
        await pilot.press("k", "p", "a")
        assert len(app.screen_stack) == 1
        await pilot.press("question_mark")
        assert "mrbt watch --top --control" in "".join(on_screen(app))


class GivenCommands(Control):
    """Notes the commands; those to the team are refused."""

    def __init__(self, robot: bool = True) -> None:
        self.given: list[dict[str, str]] = []
        self._robot = robot

    def offers(self) -> dict[str, Any]:
        """As with processes of this machine, or without."""
        robot = {name: text for name, (_, text) in ROBOT_FAULTS.items()} if self._robot else {}
        return {"robot": robot, "team": TEAM_COMMANDS}

    async def carry_out(self, command: Any) -> str:
        """Note it."""
        self.given.append(command)
        if "robot" not in command:
            raise CommandError("no robot answers")
        return "done"


@pytest.mark.parametrize(("key", "act"), [("k", "kill"), ("f", "freeze"), ("t", "thaw")])
async def test_a_command_to_a_robot_is_asked_once_and_carried_out(key: str, act: str) -> None:
    commands = GivenCommands()
    async with opened(control=commands) as (app, pilot):
        assert f"{key} {act}" in on_screen(app)[-1]
        await pilot.press("tab", "down", key)
        assert f"{act} B1?" in line_of(app, f"{act} B1")
        assert ROBOT_FAULTS[act][1][:50] in "".join(on_screen(app))
        assert commands.given == [], "nothing is done before the answer"
        await pilot.press("y")
        await app.workers.wait_for_complete()
        assert commands.given == [{"act": act, "robot": "B1"}]
        assert [told.message for told in app._notifications] == ["done"]


@pytest.mark.parametrize(("key", "act"), [("p", "pause"), ("r", "resume"), ("a", "abort")])
async def test_a_command_to_the_team(key: str, act: str) -> None:
    commands = GivenCommands()
    async with opened(control=commands) as (app, pilot):
        await pilot.press(key, "y")
        await app.workers.wait_for_complete()
        assert commands.given == [{"act": act}]
        await pilot.pause()
        (told,) = app._notifications
        assert (told.message, told.severity) == ("no robot answers", "error")


@pytest.mark.parametrize("answer", ["n", "escape", "enter", "k"])
async def test_every_other_answer_is_no(answer: str) -> None:
    commands = GivenCommands()
    async with opened(control=commands) as (app, pilot):
        await pilot.press("k", answer)
        await app.workers.wait_for_complete()
        assert commands.given == []
        assert len(app.screen_stack) == 1


async def test_only_what_is_offered_has_a_key() -> None:
    async with opened(control=GivenCommands(robot=False)) as (app, pilot):
        assert "kill" not in on_screen(app)[-1]
        assert "p pause" in on_screen(app)[-1]
        await pilot.press("k")
        assert len(app.screen_stack) == 1


async def test_robots_in_trouble_come_first_then_those_at_work() -> None:
    async with opened() as (app, _):
        assert app.query_one(RobotsPane).keys == ["A1", "B1", "B2", "A2", "C1", "C2"]
        assert app.query_one(Lanes).keys == ["A1", "B1", "B2", "A2", "C1", "C2"]


async def test_why_is_told_of_robots_and_tasks() -> None:
    async with opened(size=LARGE) as (app, pilot):
        await pilot.press("tab", "down", "down", "down")
        text = "\n".join(on_screen(app))
        assert "why A2" in text
        assert "A2 took over" in text
        assert line_of(app, "›A2  ").count("↳") == 1, "the lane is selected as well"
        await pilot.press("shift+tab", *["down"] * 10)
        text = "\n".join(on_screen(app))
        assert "diagnose_part(5) is carried out by B2" in text
        assert "It needs 1 for do_diagnosis(5)" in text


async def test_capabilities_of_the_robot_that_is_selected() -> None:
    async with opened(size=LARGE) as (app, pilot):
        await pilot.press("tab", "down")
        assert "can ✘do_diagnosis (lost: injected), " in line_of(app, "(lost: ")


async def test_search_unfolds_and_goes_on() -> None:
    async with opened() as (app, pilot):
        tree = app.query_one(TreePane)
        await pilot.press("slash", *"solder", "enter")
        assert tree.tree_rows.rows[tree.selected]["label"] == "solder(1)"
        assert "›" in line_of(app, "solder(1)")
        await pilot.press("n")
        assert tree.tree_rows.rows[tree.selected]["label"] == "solder(2)"
        await pilot.press("N", "N")
        assert tree.tree_rows.rows[tree.selected]["label"] == "solder(5)"
        await pilot.press("slash", *"xyz", "enter")
        assert [n.severity for n in app._notifications] == ["warning"]
        await pilot.press("slash", "q", "escape")
        assert app.focused is tree, "q was a letter there"


async def test_a_robots_own_tree() -> None:
    async with opened(size=LARGE) as (app, pilot):
        tree = app.query_one(TreePane)
        await pilot.press("down", "down", "tab", "down", "down", "i")
        assert "T_i of B2  Esc: T_G" in on_screen(app)[1]
        assert "▾ ▶ T_i: Parallel 3/3  running" in on_screen(app)[2]
        assert "✔ T_A, how it plans: Sequence  success" in line_of(app, "T_A, ")
        assert line_of(app, "▶ do_diagnosis  running")
        # It is that of the robot that is selected, whichever that is.
        await pilot.press("up", "up")
        assert "T_i of A1" in on_screen(app)[1]
        assert "· T_Li, its own tasks" in line_of(app, "T_Li, "), "a dead robot ticks nothing"
        assert "why A1" in line_of(app, "why")
        # It folds and is searched as T_G is.
        await pilot.press("slash", *"assign_agents", "enter")
        assert tree.tree_rows.rows[tree.selected]["label"] == "assign_agents"
        await pilot.press("left", "left")
        assert "assign_agents" not in "".join(on_screen(app))
        await pilot.press("escape")
        assert "tree" in on_screen(app)[1]
        assert tree.selected == 2, "where one was before"
        await pilot.press("i", "i")
        assert tree.robot is None


async def test_a_robot_that_has_not_joined_has_no_tree_yet() -> None:
    script, observer = watched(NOT_ALL)
    app = TeamTop(TeamView(observer), lambda: script.team.now_us)
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        await pilot.press("i")
        await pilot.pause()
        assert app.query_one(TreePane).robot is None
        assert [told.message for told in app._notifications] == ["A has not joined yet"]
        script.block(["start C", "pass 300"])
        app.look()
        await pilot.press("i")
        await pilot.pause()
        assert app.query_one(TreePane).robot == "A"


async def test_folding() -> None:
    async with opened(size=LARGE) as (app, pilot):
        tree = app.query_one(TreePane)
        folded = len(tree.keys)
        await pilot.press("o")
        assert len(tree.keys) > folded
        await pilot.press("o", "space")
        assert tree.keys == [0]
        await pilot.press("right")
        assert len(tree.keys) == folded
        await pilot.press("down", "left")
        assert tree.selected == 0, "from a leaf to what is above"


async def test_zoom_scroll_follow() -> None:
    async with opened() as (app, pilot):
        pane = app.query_one(TimelinePane)
        await pilot.press("plus", "plus")
        assert "5.77 s, follows" in line_of(app, "timeline")
        app.query_one(Lanes).focus()
        await pilot.press("left", "left")
        assert "l: follow again" in line_of(app, "timeline")
        early = pane.window(50)
        assert early.to_s < app.shown.now_s
        await pilot.press(*["left"] * 20)
        assert pane.window(50).from_s == 0.0, "back to the start, and no further"
        await pilot.press(*["right"] * 30)
        assert pane.to_s is None, "at the end it follows again"
        await pilot.press("left", "w")
        assert (pane.window(50).from_s, pane.window(50).to_s) == (0.0, app.shown.now_s)
        await pilot.press("minus", "l")
        assert pane.span_s is None


async def test_one_pane_alone() -> None:
    async with opened() as (app, pilot):
        await pilot.press("m")
        assert app.query_one(TreePane).size.height > SMALL[1] - 4
        await pilot.press("m")
        assert "robots" in on_screen(app)[2]


async def test_what_is_new_is_drawn() -> None:
    script, observer = watched(ALONE)
    app = TeamTop(TeamView(observer), lambda: script.team.now_us)
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        assert "▶ weld  A " in on_screen(app)[2]
        assert "A ● weld 0% ▱▱▱▱▱▱▱▱" in on_screen(app)[2]
        script.block(["succeed A", "pass 300"])
        app.look()
        await pilot.pause()
        assert "✔ weld  success" in on_screen(app)[2]
        assert "✔ success after" in on_screen(app)[0]
        assert app.shown.now_s > 0
        title = on_screen(app).index(line_of(app, "timeline"))
        assert "✔" in on_screen(app)[title + 1], "its lane too"


async def test_without_colours_everything_is_still_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    async with opened() as (app, pilot):
        assert os.environ["NO_COLOR"]
        colours: set[Any] = set()
        await pilot.press("tab")
        for strip in app.screen._compositor.render_strips():
            for segment in strip:
                for colour in (segment.style.color, segment.style.bgcolor) if segment.style else ():
                    if colour is not None and colour.triplet is not None:
                        colours.add(colour.triplet)
        assert colours
        assert all(c.red == c.green == c.blue for c in colours), "greys alone"
        assert line_of(app, "›A1 ✖ dead"), "what is selected has a sign"
        assert "┏━ robots━━" in on_screen(app)[2], "so has the pane that keys go to"


async def test_jobs_have_a_pane_and_are_explained() -> None:
    commands = [
        (1.0, Submit("inspect", ["shelf_1"], "near")),
        (1.0, Submit("deliver", ["shelf_6", "dock_1", 3], "far", priority=5, deadline_s=3600)),
        (1.0, Submit("inspect", ["shelf_5"], "later", not_before_s=1800)),
    ]
    mission = mission_file("deliveries")
    done = await asyncio.to_thread(run, mission, commands=commands, timeout_s=9, seed=1)
    observer = done.whole.observer
    app = TeamTop(TeamView(observer), lambda: 9 * SECOND)
    async with app.run_test(size=SMALL) as pilot:
        await pilot.pause()
        await pilot.pause()
        text = "\n".join(on_screen(app))
        assert "jobs  1 running, 1 waiting, 1 ended" in text, text
        row = line_of(app, "far deliver(shelf_6,dock_1,3)")
        assert "▶ running" in row, text
        assert "priority 5 due in 1 h" in row, text
        assert line_of(app, "◷ waiting   later inspect(shelf_5) begins in 30 min")
        await pilot.press("tab", "tab", "end")
        await pilot.pause()
        text = "\n".join(on_screen(app))
        assert "why near" in text
        assert "✔ succeeded inspect(shelf_1)  near" in text
        assert "D1 worked on it" in text


async def test_a_mission_without_jobs_has_no_pane_for_them() -> None:
    async with opened(size=LARGE) as (app, _):
        assert not app.query_one(JobsPane).display


@pytest.mark.slow
async def test_a_recording_is_played_forwards_and_back(tmp_path: Path) -> None:
    await asyncio.to_thread(
        record_example, tmp_path, "vehicle_repair", 7, [(12 * SECOND, Kill("A1"))]
    )
    player = Player(read_recording(robot_file(tmp_path, "B1")))
    shown = ShownRecording(player, player.begin_us + 13 * SECOND, 0.01)
    app = ReplayTop(shown)
    async with app.run_test(size=LARGE) as pilot:
        await pilot.press("space")
        app.look()
        await pilot.pause()
        assert "B1.mcap: 13.0 of " in on_screen(app)[1]
        assert ", paused" in on_screen(app)[1]
        assert "✖ dead" in line_of(app, "A1 ")
        assert "B1: replace_hw(2)" in "".join(on_screen(app))
        at_us = shown.playback.at_us
        await pilot.press("tab", "down", "i", "comma", "comma")
        app.look()
        await pilot.pause()
        assert shown.playback.at_us == at_us - 10 * SECOND
        assert "✖" not in "".join(on_screen(app)), "A1 lives again, and its death is not known"
        await pilot.press("comma", "full_stop", "greater_than_sign")
        assert shown.playback.at_us == player.begin_us + 5 * SECOND
        await pilot.press("space")
        assert (shown.playback.speed, shown.playback.is_paused) == (0.02, False)
        shown.playback.set_speed(1000)
        app._looked_s -= 10
        app.look()
        assert shown.playback.at_us == player.end_us
        assert shown.playback.is_paused, "at the end"
        await pilot.press("less_than_sign", "question_mark")
        assert shown.playback.speed == 500
        assert "pause, play on" in "".join(on_screen(app))


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
async def test_q_ends_it(key: str) -> None:
    async with opened() as (app, pilot):
        assert app.query_one(Footer).display
        await pilot.press(key)
        await pilot.pause()
        assert app.return_code == 0
