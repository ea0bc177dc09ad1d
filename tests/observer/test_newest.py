"""A run that never ends is watched with as much memory after months as after an hour."""

from __future__ import annotations

import pytest

from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.facts.records import CLAIM, OUTCOME, Claim, Outcome, Phase
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.observer.newest import Newest
from mrbt_mesh.observer.observer import Observer
from mrbt_mesh.observer.summary import run_summary
from tests.support.build import action, make_mission

LIFE = Incarnation(1, "n")


def test_entries_keep_their_numbers_when_older_ones_are_dropped() -> None:
    entries = Newest[int](16)
    dropped = [old for number in range(100) for old in entries.append(number)]
    assert [*dropped, *entries] == list(range(100))
    assert len(entries) <= 16
    assert (entries.total, entries.dropped, entries.first) == (100, len(dropped), len(dropped))
    assert entries.since(97) == [(97, 97), (98, 98), (99, 99)]
    assert entries.since(0)[0] == (entries.first, entries.first)
    assert (entries.get(3), entries.get(99)) == (None, 99)


def test_what_is_not_over_stays() -> None:
    entries = Newest[int](16, lambda entry: entry not in (2, 50))
    for number in range(100):
        entries.append(number)
    assert entries[:2] == [2, 50]
    assert entries.get(50) == 50
    assert entries[2] >= entries.first > 50


def test_without_a_limit_all_are_kept() -> None:
    entries = Newest[int]()
    assert not any(entries.append(number) for number in range(10_000))
    assert list(entries) == list(range(10_000))


@pytest.mark.slow
def test_a_long_run_is_counted_whole_and_kept_in_part() -> None:
    mission = make_mission(action("weld"))
    observer = Observer(mission, "r", Timing(), min_cost_flow, limit=800)
    record = observer.record
    for robot in ("A", "B"):
        record.robot_seen(robot, LIFE, 0)
    # B works all the time; A fails 50,000 times, and is dead in between once.
    working = Claim("r:0:weld::0", "weld", "weld", Phase.RUNNING, 1).to_value()
    record.fact(parse_entry("B", CLAIM, Version(LIFE, 1), working), 1)
    for number in range(1, 50_001):
        now_us, activation = number * 100, f"r:{number}:weld::0"
        claim = Claim(activation, "weld", "weld", Phase.RUNNING, 1).to_value()
        record.fact(parse_entry("A", CLAIM, Version(LIFE, 2 * number), claim), now_us)
        name = f"{OUTCOME}/{activation}/weld"
        failed = Outcome(False, None, f"reason {number}").to_value()
        record.fact(parse_entry("A", name, Version(LIFE, 2 * number + 1), failed), now_us + 1)
        record.round_runs(now_us)
        if number == 7:
            record.state("A", State.DEAD, now_us, now_us)
            record.state("A", State.ALIVE, now_us + 2, now_us + 2)
    lists = (record.timeline, record.claims, record.failures, record.work_log.spans)
    assert all(len(each) <= 800 for each in lists)
    assert record.timeline.total > 100_000
    assert record.work_log.spans[0].robot == "B", "it is still at work"
    summary = run_summary(observer, "timeout", 10**7)
    assert len(summary["failures"]) + summary["older"]["failures"] == 50_000
    assert summary["failures"][-1]["reason"] == "reason 50000"
    assert [fault["robot"] for fault in summary["faults"]] == ["A"]
    assert [(each["robot"], each["replacement"]) for each in summary["takeovers"]] == [("A", None)]
    assert summary["global_tasks"]["weld"]["robots"] == ["A", "B"]
