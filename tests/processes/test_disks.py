"""Disks that are full, locked or slow, under teams of real processes."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.disks import fill, make_read_only, small_disk
from tests.support.paths import ROOT, mission_file
from tests.support.team import Team

DISPENSE, EXPLORE = mission_file("dispense"), mission_file("explore")
FULL = "journal cannot be written: No space left on device"
NOT_RECORDED = "does not record: No space left on device"


@pytest.fixture
def disk(team: Team) -> Iterator[Path]:
    """The run directory, on a disk of its own."""
    with small_disk(team.run_dir, "16m") as path:
        yield path


def doses_begun(team: Team) -> Counter[str]:
    events = [e for e in team.events() if e["local_task"] == "dose" and e["event"] == "start"]
    return Counter(event["activation"] for event in events)


def test_a_full_disk_stops_exclusive_work_alone_until_there_is_room(team: Team, disk: Path) -> None:
    team.hold("fetch")
    team.up(DISPENSE)
    team.wait_for_events(2, "fetch")
    fill(disk)
    team.release()
    for robot in ("D1", "D2", "M1", "M2", "M3"):
        team.wait_for_line(f"{robot}: {FULL}")
    team.wait_for_line("fetch(a) done")
    team.wait_for_line("exclusive: needs grants from 3 of 5 robots whose journals can be written")
    status = team.status()
    assert [row["problems"]["journal"] for row in status["robots"].values()] == [FULL] * 5
    assert len(team.running()) == 5
    assert doses_begun(team) == Counter()
    (disk / "filler").unlink()
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success"), team.logs()
    # On a busy machine robots also say that something has kept their loops.
    files = ("journal", "recording")
    written = [each for each in summary["problems"] if each["subject"] in files]
    problems = {(each["robot"], each["subject"]): each for each in written}
    robots = sorted(summary["robots"])
    # A journal is written again once there is room. A recording that has ended stays ended.
    assert sorted(problems) == [(r, s) for r in robots for s in files]
    for robot in robots:
        assert problems[robot, "journal"]["problem"] == FULL
        assert problems[robot, "journal"]["until_s"] is not None
        assert problems[robot, "recording"]["problem"] == NOT_RECORDED
    assert summary["takeovers"] == []
    assert set(doses_begun(team).values()) == {1}
    assert len(doses_begun(team)) == 2


@pytest.mark.parametrize("trouble", ["full", "read-only"])
def test_a_run_whose_disk_is_full_or_read_only_is_continued_later(
    team: Team, disk: Path, trouble: str
) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_event("explore")
    team.kill_all()
    team.end()
    if trouble == "full":
        fill(disk)
    else:
        make_read_only(disk)
    run = ("--run-dir", str(disk))
    refused = team.command("up", str(EXPLORE), "--continue", *run)
    assert refused.returncode == 2
    assert "run.json cannot be written: " in refused.stderr
    joined = team.command("join", team.robots()[0], *run)
    if trouble == "full":  # it works, without a recording
        assert joined.returncode == 0, joined.stderr
        team.signal(team.robots()[0], signal.SIGKILL)
    else:
        assert joined.returncode == 2
        assert "summary.json cannot be removed: Read-only" in joined.stderr
    if trouble == "full":
        (disk / "filler").unlink()
    else:
        make_read_only(disk, False)
    team.release()
    team.up(EXPLORE, "--continue")
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success"), team.logs()


def test_a_robot_that_no_command_would_find_is_not_started(team: Team, disk: Path) -> None:
    team.hold("explore")
    team.up(EXPLORE)
    team.wait_for_event("explore")
    robot = team.robots()[0]
    team.signal(robot, signal.SIGKILL)
    (disk / f"{robot}.process").unlink()
    fill(disk)
    joined = team.command("join", robot, "--run-dir", str(disk))
    assert joined.returncode == 2, joined.stdout
    assert "cannot be written" in joined.stderr or "is its disk full?" in joined.stderr
    (disk / "filler").unlink()
    team.mrbt("join", robot, "--run-dir", str(disk))
    team.release()
    code, _ = team.end()
    assert code == 0, team.logs()


@pytest.mark.parametrize("sync_s", ["0.3", pytest.param("1.0", marks=pytest.mark.slow)])
def test_a_slow_disk_costs_exclusive_tasks_its_syncs_and_nobody_is_missed(
    team: Team, sync_s: str
) -> None:
    """Every write to every journal takes so long."""
    slow = str(ROOT / "tests" / "support" / "slow_disk")
    team.environment |= {"PYTHONPATH": slow, "MRBT_TEST_SYNC_S": sync_s}
    team.up(DISPENSE, speed=2)
    code, summary = team.end()
    assert (code, summary["result"]) == (0, "success"), team.logs()
    assert summary["faults"] == []
    events = {line["event"] for robot in team.robots() for line in team.log(robot)}
    assert not events & {"fenced", "catches_up", "robot_suspect"}
    assert any("journal is slow" in each["problem"] for each in summary["problems"])
    assert set(doses_begun(team).values()) == {1}
