"""Virtual time: exact, ordered, and never waiting for a real clock."""

from __future__ import annotations

import contextvars
from collections.abc import Awaitable, Callable

import anyio
import pytest

from mrbt_mesh.sim.world.clock import (
    DeadlockError,
    Gate,
    LocalClock,
    VirtualClock,
    VirtualLoop,
    current_gate,
)

DAY_S = 86_400


def run(clock: VirtualClock, main: Callable[[], Awaitable[None]]) -> None:
    anyio.run(main, backend_options={"loop_factory": lambda: VirtualLoop(clock)})


def test_days_pass_without_waiting_and_to_the_microsecond() -> None:
    clock = VirtualClock()
    seen = []

    async def main() -> None:
        for delay_s in (0.000_001, 0.1, 3.7, 400 * DAY_S, 0.000_003):
            await anyio.sleep(delay_s)
            seen.append(clock.now_us)

    run(clock, main)
    base = 400 * DAY_S * 1_000_000
    assert seen == [1, 100_001, 3_800_001, base + 3_800_001, base + 3_800_004]


@pytest.mark.parametrize("is_robots", [False, True])
def test_a_time_limit_that_is_no_whole_microsecond_ends(is_robots: bool) -> None:
    """The limit's timer is due before the limit, and is asked for again."""
    clock = VirtualClock()

    async def main() -> None:
        if is_robots:
            current_gate.set(Gate(LocalClock(clock)))
        with anyio.move_on_after(1 / 3) as scope:
            await anyio.sleep_forever()
        assert scope.cancelled_caught
        assert clock.now_us in (333_333, 333_334)

    run(clock, main)


def test_events_and_timers_happen_in_the_order_of_time_then_of_scheduling() -> None:
    clock = VirtualClock()
    seen: list[tuple[int, str]] = []

    def note(text: str) -> Callable[[], None]:
        return lambda: seen.append((clock.now_us, text))

    async def main() -> None:
        clock.at(300, note("late"))
        clock.at(100, note("first of two"))
        clock.at(100, note("second of two"))
        await anyio.sleep(0.0002)
        note("timer")()
        clock.at(50, note("never in the past"))
        await anyio.sleep(0.001)

    run(clock, main)
    assert seen == [
        (100, "first of two"),
        (100, "second of two"),
        (200, "timer"),
        (200, "never in the past"),
        (300, "late"),
    ]


def test_what_an_event_starts_runs_before_the_next_event() -> None:
    clock = VirtualClock()
    seen: list[str] = []

    async def main() -> None:
        wake = anyio.Event()
        clock.at(100, wake.set)
        clock.at(100, lambda: seen.append("next event"))
        await wake.wait()
        seen.append("woken")
        await anyio.sleep(0.001)

    run(clock, main)
    assert seen == ["woken", "next event"]


def test_a_deadlock_is_an_error_and_no_hang() -> None:
    clock = VirtualClock()

    async def main() -> None:
        clock.at(500, lambda: None)
        await anyio.Event().wait()

    with pytest.raises(DeadlockError, match="after 500 us"):
        run(clock, main)


def test_an_error_in_an_event_ends_the_run_and_no_event_follows() -> None:
    clock = VirtualClock()
    seen: list[str] = []

    def broken() -> None:
        raise ZeroDivisionError("in an event")

    async def main() -> None:
        clock.at(10, broken)
        clock.at(20, lambda: seen.append("too late"))
        await anyio.sleep(1)

    with pytest.raises(ZeroDivisionError, match="in an event"):
        run(clock, main)
    assert seen == []


def test_the_timers_of_a_frozen_robot_wait_for_its_gate() -> None:
    clock = VirtualClock()
    gate = Gate(LocalClock(clock))
    seen: list[tuple[str, int]] = []

    async def sleeper(name: str, delay_s: float) -> None:
        await anyio.sleep(delay_s)
        seen.append((name, clock.now_us))

    async def main() -> None:
        async with anyio.create_task_group() as group:
            group.start_soon(sleeper, "free", 0.000_2)

            def start() -> None:
                current_gate.set(gate)
                group.start_soon(sleeper, "second", 0.000_3)
                group.start_soon(sleeper, "first", 0.000_2)
                group.start_soon(sleeper, "later", 0.002)

            contextvars.copy_context().run(start)
            clock.at(100, gate.close)
            clock.at(1_000, gate.open)

    run(clock, main)
    assert seen == [("free", 200), ("first", 1_000), ("second", 1_000), ("later", 2_000)]


def test_a_held_timer_that_is_cancelled_does_not_fire() -> None:
    clock = VirtualClock()
    gate = Gate(LocalClock(clock))
    seen: list[str] = []

    async def main() -> None:
        current_gate.set(gate)
        with anyio.CancelScope() as scope:
            clock.at(100, gate.close)
            clock.at(500, scope.cancel)
            clock.at(500, gate.open)
            await anyio.sleep(0.000_2)
            seen.append("slept to the end")
        assert clock.now_us == 500

    run(clock, main)
    assert seen == []


def test_a_fast_or_slow_clock_times_its_robots_waits() -> None:
    clock = VirtualClock()
    fast, slow = LocalClock(clock), LocalClock(clock)
    fast.set_rate(50_000)
    slow.set_rate(-50_000)
    seen: list[tuple[str, int]] = []

    async def sleeper(name: str) -> None:
        await anyio.sleep(1)
        seen.append((name, clock.now_us))

    async def main() -> None:
        async with anyio.create_task_group() as group:
            for name, local in (("fast", fast), ("slow", slow)):
                context = contextvars.copy_context()
                context.run(current_gate.set, Gate(local))
                context.run(group.start_soon, sleeper, name)

    run(clock, main)
    assert seen == [("fast", 952_381), ("slow", 1_052_632)]
    assert fast.boottime_us == 1_105_263


def test_in_a_suspend_only_the_boot_time_clock_goes_on() -> None:
    clock = VirtualClock()
    local = LocalClock(clock)
    seen: list[int] = []

    async def main() -> None:
        gate = Gate(local)
        current_gate.set(gate)
        clock.at(100, gate.close)
        clock.at(100, local.suspend)
        clock.at(5_100, local.resume)
        clock.at(5_100, gate.open)
        await anyio.sleep(0.001)
        seen.append(clock.now_us)

    run(clock, main)
    assert seen == [6_000]
    assert (local.monotonic_us, local.boottime_us) == (1_000, 6_000)
    local.jump(500)
    assert (local.monotonic_us, local.boottime_us) == (1_000, 6_500)
