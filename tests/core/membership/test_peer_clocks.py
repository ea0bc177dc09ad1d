"""Clocks of others: jumps ahead are found, delays and drift are none."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.peer_clocks import MAX_JUMPS, PeerClocks
from mrbt_mesh.core.membership.timing import Timing

TIMING = Timing()
BEAT_US = TIMING.heartbeat_us
LEAST_US = (TIMING.promise_us - TIMING.hold_us) // 2


def heard(clocks: PeerClocks, ahead_us: int, at_us: int, process: str = "n") -> int:
    return clocks.heard("B", process, at_us + ahead_us, at_us)


def test_what_was_before_a_jump_is_older_by_it() -> None:
    clocks = PeerClocks(TIMING)
    assert heard(clocks, 7_000_000, 100) == 0
    assert heard(clocks, 7_000_000 + 5_000_000, 200) == 5_000_000
    assert (clocks.aged_us("B", 150), clocks.aged_us("B", 200)) == (150 - 5_000_000, 200)
    assert clocks.aged_us("C", 150) == 150
    assert (clocks.heard_us("B"), clocks.heard_us("C")) == (200, None)


def test_another_process_may_have_another_clock() -> None:
    clocks = PeerClocks(TIMING)
    heard(clocks, 0, 100)
    assert heard(clocks, 50_000_000, 200, "later") == 0
    assert clocks.aged_us("B", 150) == 150


@given(st.integers(2 * LEAST_US, 60_000_000), st.integers(1, BEAT_US))
def test_what_has_waited_during_a_pause_shows_all_of_it(pause_us: int, first_us: int) -> None:
    """Heartbeats that all arrive when the clock goes on, one for each period."""
    clocks, at_us = PeerClocks(TIMING), 1_000_000
    for back in range(5, 0, -1):
        heard(clocks, 0, at_us - back * BEAT_US)
    found_us = sum(
        heard(clocks, ahead_us, at_us) for ahead_us in range(first_us, pause_us, BEAT_US)
    )
    assert pause_us - found_us <= LEAST_US + 2 * BEAT_US
    assert clocks.aged_us("B", at_us - 1) == at_us - 1 - found_us


DELAYS_US = st.lists(st.integers(0, 5_000_000), min_size=20, max_size=60)


@given(
    st.one_of(
        st.tuples(DELAYS_US, st.integers(-1, 1)),
        st.tuples(st.just([0] * 60), st.integers(-300, 300)),
    )
)
def test_delays_and_clocks_of_other_rates_are_no_jumps(case: tuple[list[int], int]) -> None:
    (delays_us, permille), clocks, arrived_us = case, PeerClocks(TIMING), 0
    heard(clocks, 0, 0)
    for number, delay_us in enumerate(delays_us, 1):
        sent_us = number * BEAT_US
        arrived_us = max(arrived_us, sent_us + delay_us)
        shows_us = sent_us + sent_us * permille // 1_000
        assert clocks.heard("B", "n", shows_us, arrived_us) == 0


@given(st.lists(st.integers(LEAST_US, 9_000_000), min_size=MAX_JUMPS, max_size=3 * MAX_JUMPS))
def test_many_jumps_are_remembered_as_at_least_as_many(jumps_us: list[int]) -> None:
    clocks, ahead_us, before_us = PeerClocks(TIMING), 0, []
    heard(clocks, 0, 0)
    for number, jump_us in enumerate(jumps_us, 1):
        ahead_us += jump_us
        before_us.append((number - 1, sum(jumps_us[number - 1 :])))
        assert heard(clocks, ahead_us, number) == jump_us
    for at_us, passed_us in before_us:
        assert clocks.aged_us("B", at_us) <= at_us - passed_us
    assert clocks.aged_us("B", len(jumps_us)) == len(jumps_us)
