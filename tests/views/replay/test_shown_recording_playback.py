"""Where a replay is: never outside of its recording, and as fast as is wanted."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mrbt_mesh.recording.folder import observer_file
from mrbt_mesh.recording.player import Player
from mrbt_mesh.recording.reader import Recording, read_recording
from mrbt_mesh.views.replay.shown_recording import FASTEST, SLOWEST, Playback
from tests.support.recorded import record_example


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("playback")
    record_example(folder, "explore", 3)
    return read_recording(observer_file(folder))


WISHES = st.one_of(
    st.tuples(st.just("go_to"), st.integers(-(10**8), 10**8)),
    st.tuples(st.just("set_speed"), st.floats(1e-6, 1e6)),
    st.tuples(st.just("passed"), st.floats(0, 100)),
)


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(WISHES, max_size=8))
def test_whatever_is_wished_it_stays_within(recording: Recording, wishes: list[tuple]) -> None:  # type: ignore[type-arg]
    player = Player(recording)
    playback = Playback(player, player.begin_us, 1.0)
    for name, value in wishes:
        before_us, speed = playback.at_us, playback.speed
        getattr(playback, name)(value)
        assert player.begin_us <= playback.at_us <= player.end_us
        assert SLOWEST <= playback.speed <= FASTEST
        if name == "passed":
            wanted_us = before_us + round(value * speed * 1_000_000)
            assert playback.at_us == min(wanted_us, player.end_us)
    playback.catch_up()
    assert player.now_us == playback.at_us


def test_while_it_is_paused_no_time_passes(recording: Recording) -> None:
    playback = Playback(Player(recording), 1_000_000, 2.0)
    playback.is_paused = True
    playback.passed(3.0)
    assert playback.at_us == 1_000_000
    playback.is_paused = False
    playback.passed(10**6)
    assert playback.is_at_end
