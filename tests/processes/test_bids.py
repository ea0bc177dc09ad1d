"""Couriers that bid, on real processes: one is killed on its way, and the mission goes on."""

from __future__ import annotations

import signal

import pytest

from mrbt_mesh.drills.physical import spans
from tests.support.paths import mission_file
from tests.support.team import TEST_TIMEOUT_S, Team

pytestmark = [pytest.mark.processes, pytest.mark.timeout(TEST_TIMEOUT_S)]

COURIERS = mission_file("couriers")


def test_couriers_bid_and_one_is_replaced_by_another_that_bid(team: Team) -> None:
    team.hold("deliver")
    team.up(COURIERS)
    victim = team.wait_for_work(team.wait_for_event("deliver"))
    team.signal(victim["robot"], signal.SIGKILL)
    team.wait_for_line(f"{victim['robot']} is dead")
    team.release()
    code, summary = team.end()
    assert code == 0, team.logs()
    done = {s.part: s.robot for s in spans(team.events()) if s.end == "success"}
    assert len(done) == 6
    rows = {row["local_task"]: row for row in summary["bids"]}
    assert len(rows) == 6
    for parcel, robot in done.items():
        row = rows[f"deliver({parcel})"]
        assert robot in row["robots"]
        assert all(bid is None or bid < 0 for bid in row["bids"].values())
    (takeover,) = summary["takeovers"]
    assert takeover["replacement"] in rows[takeover["held"]]["bids"]
    logged = [line for robot in team.robots() for line in team.log(robot)]
    assert not [line for line in logged if line.get("event") == "bid_failed"]
