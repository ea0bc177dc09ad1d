"""The keys of a replay in a terminal."""

from __future__ import annotations

from pathlib import Path

import pytest

from mrbt_mesh.cli.recordings.replaying import DOWN, LEFT, RIGHT, UP, Playing
from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import read_recording
from tests.support.recorded import record_example


@pytest.fixture
def playing(tmp_path: Path) -> Playing:
    record_example(tmp_path, "explore", 3)
    return Playing(Player(read_recording(observer_file(tmp_path))), 1.0, 2.0)


def test_time_goes_on_as_fast_as_wanted_and_stops_at_the_end(playing: Playing) -> None:
    begin_us, end_us = playing.player.begin_us, playing.player.end_us
    assert playing.at_us == begin_us + 1_000_000
    playing.passed(0.5)
    assert playing.at_us == begin_us + 2_000_000
    playing.press(UP)
    playing.passed(0.25)
    assert playing.at_us == begin_us + 3_000_000
    playing.press(DOWN)
    playing.press(b" ")
    playing.passed(10)
    assert playing.at_us == begin_us + 3_000_000
    assert "paused" in playing.line()
    playing.press(b" ")
    playing.passed(10_000)
    assert playing.at_us == playing.player.now_us == end_us


def test_the_arrows_go_back_and_forth_and_q_ends(playing: Playing) -> None:
    player = playing.player
    playing.press(LEFT)
    assert playing.at_us == player.begin_us
    playing.press(RIGHT)
    assert playing.at_us == min(player.begin_us + 5_000_000, player.end_us)
    playing.press(b"x")
    assert not playing.is_over
    playing.press(b"q")
    assert playing.is_over
