"""Who is there: by signs of life, held against a plain account of who was heard when."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.adapters.ros2.bridge.watch import ASKS, LISTED_S, LifeAnswers, LifeWatch

DETECTION_S = 1.0
TICK_S = 0.05


@given(st.lists(st.booleans(), max_size=200))
def test_who_is_silent_for_the_detection_time_is_gone(signs: list[bool]) -> None:
    """One sign or none per tick of a process that never stands still."""
    watch = LifeWatch(DETECTION_S, 0.0)
    heard: int | None = None
    for tick, sign in enumerate(signs, start=1):
        now_s = tick * TICK_S
        if sign:
            watch.heard(now_s)
            heard = tick
        watch.tick(now_s)
        silent = None if heard is None else tick - heard
        # 20 ticks are a second; floats may put the very tick on either side.
        if silent is not None and silent not in (19, 20, 21):
            assert watch.is_there is (silent < 20)
        if silent is not None and silent > 21:
            heard = None


def test_it_is_asked_often_enough_to_be_missed_in_time() -> None:
    watch = LifeWatch(DETECTION_S, 0.0)
    watch.heard(0.0)
    asked = [tick * TICK_S for tick in range(1, 21) if watch.tick(tick * TICK_S)]
    assert len(asked) >= ASKS - 1
    assert not watch.is_there


def test_whoever_speaks_is_not_asked() -> None:
    watch = LifeWatch(DETECTION_S, 0.0)
    for tick in range(1, 100):
        watch.heard(tick * TICK_S)
        assert not watch.tick(tick * TICK_S)


def test_nobody_is_gone_because_this_process_stood_still() -> None:
    watch = LifeWatch(DETECTION_S, 0.0)
    watch.heard(0.0)
    watch.tick(0.1)
    watch.tick(60.0)
    assert watch.is_there
    # From then on it is silent.
    for tick in range(1, 25):
        watch.tick(60.0 + tick * TICK_S)
    assert not watch.is_there


def test_what_is_known_to_be_gone_is_asked_again() -> None:
    watch = LifeWatch(DETECTION_S, 0.0)
    watch.heard(0.1)
    watch.gone()
    assert not watch.is_there
    assert any(watch.tick(0.1 + tick * TICK_S) for tick in range(10))
    watch.heard(0.7)
    assert watch.is_there


def test_being_listed_counts_unless_a_node_has_answered_lately() -> None:
    answers = LifeAnswers()
    assert answers.does_listing_count(0.0)
    answers.answered(1.0)
    assert not answers.does_listing_count(1.0)
    answers.answered(2.0)
    assert not answers.does_listing_count(1.0 + LISTED_S)
    assert answers.does_listing_count(2.0 + LISTED_S)
