"""A robot that has trouble itself waits longer for others."""

from mrbt_mesh.core.membership.ring import MAX_EXTRA_DETECTIONS, LocalHealth
from mrbt_mesh.core.membership.timing import Timing

TIMING = Timing()
DETECTION_US = TIMING.detection_us


def test_a_robot_without_trouble_waits_no_longer() -> None:
    health = LocalHealth(TIMING)
    assert (health.extra_us, health.better_at_us) == (0, None)


def test_trouble_counts_once_per_heartbeat_period_up_to_a_bound() -> None:
    health = LocalHealth(TIMING)
    health.worsen(0)
    health.worsen(TIMING.heartbeat_us - 1)
    assert health.extra_us == DETECTION_US
    for period in range(1, 10):
        health.worsen(period * TIMING.heartbeat_us)
    assert health.extra_us == MAX_EXTRA_DETECTIONS * DETECTION_US


def test_it_gets_better_step_by_step_after_the_longest_silence() -> None:
    health = LocalHealth(TIMING)
    health.worsen(0)
    health.worsen(TIMING.heartbeat_us)
    first_us = TIMING.heartbeat_us + TIMING.max_silence_us
    assert health.better_at_us == first_us
    health.recover(first_us - 1)
    assert health.extra_us == 2 * DETECTION_US
    health.recover(first_us)
    assert health.extra_us == DETECTION_US
    assert health.better_at_us == first_us + DETECTION_US
    health.recover(first_us + DETECTION_US)
    assert (health.extra_us, health.better_at_us) == (0, None)
