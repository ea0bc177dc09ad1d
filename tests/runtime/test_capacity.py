"""How many robots a machine carries, by the stated cost of one."""

from __future__ import annotations

import resource

import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.errors import InputError
from mrbt_mesh.runtime.capacity import (
    BEAT_COST_S,
    MOST_OF_CORES,
    MOST_OF_MEMORY,
    ROBOT_MEMORY_MB,
    Machine,
    allow_open_files,
    overload,
)

LARGE_MB = 1_000_000
BEATS_S = st.integers(1, 3_600).map(lambda tenths: tenths / 10)


def test_six_robots_with_the_default_knobs_are_no_overload_on_a_small_computer() -> None:
    assert overload(6, 0.2, 1.0, Machine(1, 1_000)) is None


def test_one_robot_is_never_too_many() -> None:
    assert overload(1, 0.001, 1.0, Machine(1, 1)) is None


@given(st.integers(1, 2_000), BEATS_S, st.integers(1, 64), st.integers(1, LARGE_MB))
def test_what_is_carried_is_no_overload_and_one_robot_more_is(
    robots: int, beat_s: float, cores: int, memory_mb: int
) -> None:
    machine = Machine(cores, memory_mb)
    found = overload(robots, beat_s, 5 * beat_s, machine)
    if found is None:
        assert robots == 1 or robots * BEAT_COST_S / beat_s <= cores * MOST_OF_CORES * 1.000001
        assert robots == 1 or robots * ROBOT_MEMORY_MB <= memory_mb * MOST_OF_MEMORY
        return
    assert 1 <= found.carried < robots
    assert overload(found.carried, beat_s, 5 * beat_s, machine) is None
    assert overload(found.carried + 1, beat_s, 5 * beat_s, machine) is not None


@given(st.integers(2, 2_000), BEATS_S, st.integers(1, 64), st.integers(1, LARGE_MB))
def test_the_knobs_that_are_proposed_are_enough_and_fit_together(
    robots: int, beat_s: float, cores: int, memory_mb: int
) -> None:
    machine = Machine(cores, memory_mb)
    found = overload(robots, beat_s, 5 * beat_s, machine)
    if found is None or found.enough_beat_s is None:
        assert found is None or robots * ROBOT_MEMORY_MB > memory_mb * MOST_OF_MEMORY
        return
    assert found.enough_detection_s is not None
    assert found.limit == "processor"
    assert found.enough_beat_s > beat_s
    Timing(round(1e6 * found.enough_beat_s), round(1e6 * found.enough_detection_s))
    assert overload(robots, found.enough_beat_s, found.enough_detection_s, machine) is None


def test_slower_beats_are_no_remedy_for_want_of_memory() -> None:
    found = overload(100, 10.0, 50.0, Machine(2, 1_000))
    assert found is not None
    assert (found.limit, found.enough_beat_s, found.enough_detection_s) == ("memory", None, None)


def test_a_longer_detection_time_is_kept() -> None:
    found = overload(100, 0.2, 60.0, Machine(1, LARGE_MB))
    assert found is not None
    assert found.enough_detection_s == 60.0


def test_this_machine() -> None:
    found = Machine.here()
    assert 1 <= found.cores <= (psutil.cpu_count() or 1)
    assert 1 <= found.free_memory_mb <= psutil.virtual_memory().total / 1e6


def test_a_low_limit_of_open_files_is_raised_as_far_as_it_may(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    raised: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "setrlimit", lambda _, limits: raised.append(limits))
    for soft, hard in ((1024, 4096), (40, 4096), (resource.RLIM_INFINITY,) * 2):
        monkeypatch.setattr(resource, "getrlimit", lambda _, found=(soft, hard): found)
        allow_open_files(20)
    assert raised == [(76, 4096)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: (40, 75))
    with pytest.raises(InputError, match=r"may open 75 files here .* 20 robots needs 76"):
        allow_open_files(20)
