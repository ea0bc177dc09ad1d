"""When a robot beats."""

from __future__ import annotations

from mrbt_mesh.core.membership.timing import HeartbeatSchedule, Timing

MS = 1_000
TIMING = Timing(200 * MS, 1_000 * MS)


def beats_ms(schedule: HeartbeatSchedule, urgent: str, from_ms: int, until_ms: int) -> list[int]:
    """When it beats in that time, if nothing changes."""
    sent = []
    for ms in range(from_ms, until_ms):
        if schedule.is_due((urgent,), ms * MS):
            schedule.mark_sent((urgent,), ms * MS)
            sent.append(ms)
    return sent


def test_regular_beats() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    assert beats_ms(schedule, "plan", 0, 700) == [0, 25, 50, 100, 300, 500]


def test_what_has_changed_is_beaten_out_at_once_and_repeated() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    beats_ms(schedule, "plan", 0, 1_010)
    assert beats_ms(schedule, "another", 1_010, 1_400) == [1_010, 1_035, 1_060, 1_110, 1_310]


def test_it_hurries_for_one_beat_period_from_the_last_beat_on() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    assert beats_ms(schedule, "plan", 0, 301)[-1] == 300
    schedule.speed_up(3, 310 * MS)
    assert beats_ms(schedule, "plan", 310, 1_000) == [350, 400, 450, 500, 550, 750, 950]


def test_hurry_that_comes_late_is_due_at_once() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    beats_ms(schedule, "plan", 0, 301)
    schedule.speed_up(3, 480 * MS)
    assert schedule.next_due_us <= 480 * MS


def test_hurry_in_a_large_team_changes_nothing() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    beats_ms(schedule, "plan", 0, 301)
    schedule.speed_up(64, 310 * MS)
    assert beats_ms(schedule, "plan", 310, 800) == [500, 700]


def test_a_heartbeat_for_some_does_not_put_off_the_one_for_all_who_expect_it() -> None:
    schedule = HeartbeatSchedule(TIMING, 0)
    schedule.mark_sent(("a",), 0)
    schedule.mark_sent(("b",), 90 * MS, is_plan_only=True)
    assert not schedule.is_regular_due(TIMING.heartbeat_us - 1)
    assert schedule.is_regular_due(TIMING.heartbeat_us)
    assert schedule.next_due_us < TIMING.heartbeat_us, "it is repeated"
    assert schedule.last_sent_us == 0
