"""How long a silence may last: what was measured, and the formula that follows from it."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.peer import ArrivalHistory
from mrbt_mesh.core.membership.timing import ODDS_BITS, Timing

BEAT_US = 200_000
TIMING = Timing(BEAT_US, 1_000_000)

gaps = st.lists(st.integers(0, 5_000_000), max_size=300)


def heard(*gaps_us: int) -> ArrivalHistory:
    history = ArrivalHistory.of_new_robot(TIMING)
    for gap_us in gaps_us:
        history.add_interval(gap_us, TIMING)
    return history


def test_a_robot_that_is_new_is_trusted_for_twice_the_detection_time() -> None:
    assert heard().overdue_permille == 250
    assert TIMING.silence_limit_us(250) == 2 * TIMING.detection_us


def test_after_thirteen_regular_beats_the_limit_is_the_detection_time() -> None:
    assert TIMING.silence_limit_us(heard(*[BEAT_US] * 12).overdue_permille) > TIMING.detection_us
    assert TIMING.silence_limit_us(heard(*[BEAT_US] * 13).overdue_permille) == TIMING.detection_us


def test_quick_repeats_say_nothing_about_the_network() -> None:
    assert heard(*[BEAT_US // 8] * 8, BEAT_US) == heard(*[BEAT_US] * 2)


def test_a_gap_of_up_to_a_quarter_more_than_a_beat_period_is_regular() -> None:
    regular, late = BEAT_US * 5 // 4, BEAT_US * 5 // 4 + 1
    assert heard(regular).overdue_us == heard().overdue_us
    assert heard(late).overdue_us == heard().overdue_us + 1


def test_old_experience_is_outweighed() -> None:
    bad = heard(*[5 * BEAT_US] * 100)
    assert TIMING.silence_limit_us(bad.overdue_permille) == TIMING.max_silence_us
    for _ in range(1_000):
        bad.add_interval(BEAT_US, TIMING)
    assert TIMING.silence_limit_us(bad.overdue_permille) == TIMING.detection_us


@given(gaps)
def test_the_share_is_one_and_the_sums_stay_small(gaps_us: list[int]) -> None:
    history = heard(*gaps_us)
    assert 0 <= history.overdue_us <= history.observed_us
    assert 0 <= history.overdue_permille <= 1_000
    assert history.observed_us <= 128 * BEAT_US + 5_000_000


@given(st.integers(1_000, 1_000_000), st.integers(3, 20))
def test_the_limit_grows_with_silence_from_the_shortest_to_the_longest(
    beat_us: int, beats: int
) -> None:
    timing = Timing(beat_us, beats * beat_us)
    limits = [timing.silence_limit_us(silence) for silence in range(1_001)]
    assert limits == sorted(limits)
    assert (limits[0], limits[-1]) == (timing.detection_us, timing.max_silence_us)
    assert min(limits) == timing.fence_us, "a robot fences before anybody can have replaced it"
    assert max(limits) < timing.max_detection_us


@given(st.integers(1, 999))
def test_the_limit_is_the_fewest_beats_that_chance_does_not_explain(silence: int) -> None:
    timing = Timing(1_000, 1_000_000)  # so short beats that neither bound plays a part
    beats = timing.silence_limit_us(silence) // timing.heartbeat_us
    share = silence / 1_000
    if timing.detection_us < timing.silence_limit_us(silence) < timing.max_silence_us:
        assert share**beats < 1.001 / 2**ODDS_BITS
        assert share ** (beats - 1) > 0.999 / 2**ODDS_BITS


def test_while_a_robot_is_probed_all_beat_faster_but_nobody_is_swamped() -> None:
    for robots in range(2, 200):
        pace_us = TIMING.fast_heartbeat_us(robots)
        assert BEAT_US // 4 <= pace_us <= BEAT_US
        assert robots * BEAT_US // pace_us <= max(robots, 36)
    assert TIMING.fast_heartbeat_us(6) == BEAT_US // 4
    assert TIMING.fast_heartbeat_us(64) == BEAT_US


def test_in_a_larger_team_nobody_is_sooner_taken_for_dead_by_chance() -> None:
    """Six neighbours judge each robot; of seven robots every pair."""
    for robots in range(8, 1_001):
        timing = Timing().of_team(robots)
        assert 6 * robots * 2**ODDS_BITS <= 6 * 7 * 2**timing.odds_bits
        assert timing.detection_us == Timing().detection_us * 3 // 2
        # On a good network, once it was heard for 64 periods.
        overdue_permille = -(-1_000 // (64 + 4))
        assert timing.silence_limit_us(overdue_permille) * 2 <= timing.detection_us * 3
