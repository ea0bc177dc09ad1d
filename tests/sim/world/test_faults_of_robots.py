"""What befalls one robot: a lost journal tail, slowness, suspend, skewed clocks, old messages."""

from __future__ import annotations

from typing import Any

import pytest

from mrbt_mesh.core.agent.effects import Persist
from mrbt_mesh.core.agent.inputs import JournalOpened, JournalReported, JournalSynced
from mrbt_mesh.core.facts.records import OUTCOME
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.drills.physical import of, spans
from mrbt_mesh.sim import (
    ClockJump,
    ClockRate,
    Disk,
    Disturb,
    Fault,
    Freeze,
    Heal,
    Kill,
    KillAfter,
    Lose,
    Replay,
    Restart,
    Slow,
    Suspend,
    Thaw,
    partition,
)
from mrbt_mesh.sim.world.clock import Gate, LocalClock, VirtualClock
from mrbt_mesh.sim.world.faults import Operate
from mrbt_mesh.sim.world.journal import FULL, SimJournal, SimJournalWriter
from mrbt_mesh.sim.world.network import LinkKnobs
from mrbt_mesh.sim.world.pace import Pace
from tests.support.effort import seeds
from tests.support.runs import Run, undisturbed

SECOND_US = 1_000_000
ROBOTS = ["A1", "A2", "B1", "B2", "C1", "C2"]


def entry(name: str, sequence: int) -> Any:
    return parse_entry(
        "A1", f"{OUTCOME}/x/{name}", Version(Incarnation(1, "n"), sequence), [True, 0]
    )


class Writing:
    """A process' journal on its disk, and the news of it with the times in ms."""

    def __init__(self, journal: SimJournal | None = None) -> None:
        self.journal = journal or SimJournal()
        self.clock = VirtualClock()
        self.pace = Pace(self.clock, Gate(LocalClock(self.clock)), lambda event: None)
        self.news: list[tuple[int, Any]] = []
        self.writer = SimJournalWriter(
            self.journal, self.clock, self.pace, self.tell, lambda changes: None
        )

    def tell(self, news: Any) -> None:
        self.news.append((self.clock.now_us // 1_000, news))

    def pass_ms(self, ms: int) -> None:
        until_us = self.clock.now_us + ms * 1_000
        while self.clock.now_us < until_us:
            self.clock.advance((until_us - self.clock.now_us) / 1e6)


def test_a_crash_loses_what_was_not_written() -> None:
    at = Writing()
    at.writer.carry_out(Persist((entry("a", 1),), True, 1))
    at.pass_ms(1)
    at.journal.sync_us = 300_000
    at.writer.carry_out(
        Persist(
            (
                entry("a", 2),
                entry("b", 3),
            ),
            True,
            2,
        )
    )
    at.pass_ms(200)
    at.pace.end()
    at.pass_ms(1_000)
    assert at.journal.read() == (entry("a", 1),)
    assert at.news == [(0, JournalSynced(1))]


def test_a_slow_disk_syncs_together_what_waits() -> None:
    at = Writing()
    at.journal.sync_us = 300_000
    for number in (1, 2, 3):
        at.writer.carry_out(Persist((entry("a", number),), True, number))
        at.pass_ms(1)
    at.pass_ms(700)
    assert at.news == [(300, JournalSynced(1)), (600, JournalSynced(3))]


def test_a_disk_that_fails_is_tried_again() -> None:
    at = Writing()
    at.journal.fails = True
    at.writer.carry_out(Persist((entry("a", 1),), True, 1))
    at.pass_ms(2_500)
    at.journal.fails = False
    at.pass_ms(1_000)
    reported = [JournalReported(FULL, is_failing=True), JournalReported(""), JournalSynced(1)]
    assert at.news == list(zip([0, 3_000, 3_000], reported, strict=True))


def test_what_is_put_while_a_slow_disk_fails_is_tried_again_too() -> None:
    at = Writing()
    at.journal.sync_us = 300_000
    at.writer.carry_out(Persist((entry("a", 1),), True, 1))
    at.pass_ms(100)
    at.journal.fails = True
    at.writer.carry_out(Persist((entry("b", 2),), True, 2))
    at.pass_ms(1_000)
    at.journal.fails = False
    at.pass_ms(1_000)
    assert at.news[-1] == (1_600, JournalSynced(2))
    assert len(at.journal.read()) == 2


def test_a_journal_that_was_locked_is_read_later() -> None:
    journal = SimJournal()
    journal.write({("A1", "x"): entry("a", 1)})
    journal.is_locked = True
    at = Writing(journal)
    at.writer.start()
    assert not at.writer.is_read
    at.pass_ms(2_500)
    journal.is_locked = False
    at.pass_ms(1_000)
    assert at.writer.is_read
    assert [news for _, news in at.news] == [JournalOpened((entry("a", 1),)), JournalReported("")]


def outcomes_in_the_journal(run: Run, killed_us: int) -> int:
    """How many outcomes B1 still has when it is restarted alone, all others gone for good."""
    schedule: list[tuple[int, Fault]] = [(killed_us, Kill(robot)) for robot in ROBOTS]
    schedule.append((killed_us + SECOND_US, Restart("B1")))
    timeout_us = killed_us + 3 * SECOND_US
    result = run("vehicle_repair", 3, schedule=schedule, expect=None, timeout_us=timeout_us)
    facts = result.agents["B1"].view.facts
    return sum(
        len(robots) for said in facts.activations.values() for robots in said.outcomes.values()
    )


def test_a_killed_robot_forgets_what_it_heard_a_moment_ago_but_not_what_it_said(run: Run) -> None:
    screws = [s.end_s for s in of(undisturbed(3), "use_screwdriver")[:2]]
    heard_us = round(max(screws) * 1e6) + 20_000
    assert outcomes_in_the_journal(run, heard_us) == 0
    assert outcomes_in_the_journal(run, heard_us + 150_000) == 2
    own = min(s.end_s for s in of(undisturbed(3), "do_diagnosis") if s.robot == "B1")
    assert outcomes_in_the_journal(run, round(own * 1e6) + 1_000) >= 3


@pytest.mark.parametrize("actions", [1, 2])
def test_a_robot_that_dies_of_its_work_has_told_how_its_last_action_ended(
    run: Run, actions: int
) -> None:
    own = sorted((s for s in undisturbed(3) if s.robot == "B1"), key=lambda s: s.end_s)
    died_s = own[actions - 1].end_s
    result = run("vehicle_repair", 3, schedule=[(0, KillAfter("B1", actions))])
    ended = [s for s in spans(result.events) if s.robot == "B1" and s.end == "success"]
    assert len(ended) == actions
    assert [fault["robot"] for fault in result.summary["faults"]] == ["B1"]
    assert result.summary["faults"][0]["at_s"] == pytest.approx(died_s, abs=0.1)
    facts = result.agents["A1"].view.facts
    told = [ends for said in facts.activations.values() for ends in said.outcomes.values()]
    assert sum("B1" in outcomes for outcomes in told) == actions
    assert result.done_twice == 0


def test_work_that_was_cancelled_wears_nobody_out(run: Run) -> None:
    first = min((s for s in undisturbed(3) if s.robot == "B1"), key=lambda s: s.start_s)
    lost_us = round((first.start_s + first.end_s) / 2 * 1e6)
    schedule = [(0, KillAfter("B1", 1)), (lost_us, Lose("B1", "all"))]
    result = run("vehicle_repair", 3, schedule=schedule, expect=None, timeout_us=60 * SECOND_US)
    own = [s.end for s in spans(result.events) if s.robot == "B1"]
    assert own == ["cancel"]
    assert "B1" in result.stops or result.result != "success"


def test_nobody_dies_of_no_action() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        KillAfter("B1", 0)


@pytest.mark.parametrize("seed", seeds(5))
def test_a_team_that_is_killed_as_a_whole_goes_on_from_its_journals(run: Run, seed: int) -> None:
    schedule: list[tuple[int, Fault]] = [(12 * SECOND_US, Kill(robot)) for robot in ROBOTS]
    schedule += [(14 * SECOND_US + 10_000 * i, Restart(robot)) for i, robot in enumerate(ROBOTS)]
    result = run("vehicle_repair", seed, schedule=schedule)
    done = [s for s in spans(result.events) if s.end == "success"]
    assert len({(s.activation, s.local_task, s.part, s.robot) for s in done}) == len(done)


def test_a_slow_robot_is_late_but_does_its_part(run: Run) -> None:
    schedule = [(SECOND_US, Slow("A1", 150_000)), (10 * SECOND_US, Slow("A1", 0))]
    result = run("vehicle_repair", 3, schedule=schedule, keep_log=True)
    assert result.summary["faults"] == []
    times = [line.split()[0] for line in result.effect_log if line.split()[1] == "A1"]
    slow = {int(t) for t in times if 2 * SECOND_US < int(t) < 9 * SECOND_US}
    assert {(t - SECOND_US) % 150_000 for t in slow} == {0}


def test_a_robot_that_is_slower_than_the_detection_time_is_given_up(run: Run) -> None:
    schedule = [(SECOND_US, Slow("A1", 1_600_000)), (20 * SECOND_US, Slow("A1", 0))]
    result = run("vehicle_repair", 3, schedule=schedule)
    assert {fault["robot"] for fault in result.summary["faults"]} == {"A1"}


@pytest.mark.parametrize("fault", [Freeze("A1"), Suspend("A1")])
def test_a_suspended_robot_fences_itself_and_its_work_is_cancelled(run: Run, fault: Fault) -> None:
    before = next(s for s in of(undisturbed(3), "do_diagnosis") if s.robot == "A1")
    asleep_us = round(before.start_s * 1e6) + 500_000
    schedule = [(asleep_us, fault), (asleep_us + 5 * SECOND_US, Thaw("A1"))]
    result = run("vehicle_repair", 3, schedule=schedule, keep_log=True)
    own = next(s for s in of(spans(result.events), "do_diagnosis", before.part) if s.robot == "A1")
    assert own.end == "cancel"
    assert own.end_s == pytest.approx(asleep_us / 1e6 + 5, abs=1e-6)
    assert sum('"fenced"' in line for line in result.effect_log) == 1


@pytest.mark.parametrize(("at_s", "event"), [(6, "fenced"), (4, "catches_up")])
def test_a_boot_time_clock_that_jumps_fences_a_robot_at_work(
    run: Run, at_s: int, event: str
) -> None:
    at_work = any(s.start_s < at_s < s.end_s for s in undisturbed(3) if s.robot == "A1")
    assert at_work == (event == "fenced")
    schedule = [(at_s * SECOND_US, ClockJump("A1", 30 * SECOND_US))]
    result = run("vehicle_repair", 3, schedule=schedule, keep_log=True)
    found = [e for line in result.effect_log for e in ("fenced", "catches_up") if f'"{e}"' in line]
    assert found == [event]


def test_clocks_that_run_five_percent_apart_harm_nobody(run: Run) -> None:
    schedule = [
        (0, ClockRate("A1", 50_000)),
        (0, ClockRate("B1", -50_000)),
        (0, ClockJump("C1", 3_600 * SECOND_US)),
    ]
    result = run("vehicle_repair", 3, schedule=schedule)
    assert result.summary["faults"] == []
    length = {s.robot: s.end_s - s.start_s for s in of(spans(result.events), "do_diagnosis")}
    assert length["A1"] == pytest.approx(2 / 1.05, abs=0.01)
    assert length["B1"] == pytest.approx(6 / 0.95, abs=0.01)


def test_old_messages_change_nothing(run: Run) -> None:
    expected = run("vehicle_repair", 3)
    schedule = [
        (at_s * SECOND_US + 7, Replay(robot, source, (at_s - 3) * SECOND_US, 20))
        for at_s in range(4, 20, 3)
        for robot in ROBOTS
        for source in ROBOTS
        if robot != source
    ]
    result = run("vehicle_repair", 3, schedule=schedule)
    assert result.events == expected.events


def test_a_robot_may_come_for_the_first_time_in_the_middle(run: Run) -> None:
    early = [robot for robot in ROBOTS if robot not in ("A1", "C1")]
    schedule = [(6 * SECOND_US, Restart("C1")), (8 * SECOND_US, Restart("A1"))]
    result = run("vehicle_repair", 3, schedule=schedule, robots=early)
    assert result.summary["duration_s"] > 25
    assert any(span.robot == "A1" for span in spans(result.events))


def test_healing_ends_every_fault(run: Run) -> None:
    schedule: list[tuple[int, Fault]] = [
        (SECOND_US, Kill("C1")),
        (SECOND_US, Freeze("C2")),
        (SECOND_US, Slow("B1", 400_000)),
        (SECOND_US, Suspend("B2")),
        (SECOND_US, Lose("A1", "all")),
        (SECOND_US, partition(["A1"], ["A2"])),
        (SECOND_US, Disturb(LinkKnobs(loss_permille=900))),
        (SECOND_US, ClockRate("A2", 40_000)),
        (4 * SECOND_US, Operate("A2", "paused", "pause")),
    ]
    timeout_us = 40 * SECOND_US
    run("vehicle_repair", 3, schedule=schedule, expect="timeout", timeout_us=timeout_us)
    schedule.append((9 * SECOND_US, Heal(("C1",))))
    result = run("vehicle_repair", 3, schedule=schedule, timeout_us=timeout_us)
    assert result.summary["duration_s"] < 34


def test_a_capability_lost_from_the_beginning_is_lost(run: Run) -> None:
    result = run("vehicle_repair", 3, schedule=[(0, Lose("C1", "move_frame"))], expect="blocked")
    assert result.summary["robots"]["C1"]["lost"] == {"move_frame": "injected"}
    assert result.summary["blocked"][0]["reason"] == "blocked: move_frame needs 2, 1 alive"


# -- disks ------------------------------------------------------------------------------------

DOSERS = ("D1", "D2", "M1", "M2", "M3")


@pytest.mark.slow
@pytest.mark.parametrize("robots", [("D1",), DOSERS], ids=["one", "all"])
@pytest.mark.parametrize(
    "how",
    [
        {"sync_us": 50_000},
        {"sync_us": 300_000},
        {"sync_us": SECOND_US},
        {"fails": True},
        {"fails": True, "is_locked": True},
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", seeds(3))
def test_a_bad_disk_costs_promises_and_no_robot(
    run: Run, seed: int, how: dict[str, Any], robots: tuple[str, ...]
) -> None:
    """Where it fails, the team is killed and started again while its journals cannot be read."""
    schedule: list[tuple[int, Fault]] = [(0, Disk(robot, **how)) for robot in robots]
    if "is_locked" in how:
        schedule = [(SECOND_US, Kill(robot)) for robot in DOSERS]
        schedule += [(SECOND_US + 1, Disk(robot, **how)) for robot in robots]
        schedule += [(2 * SECOND_US, Restart(robot)) for robot in DOSERS]
    if "fails" in how:
        schedule += [(8 * SECOND_US, Disk(robot)) for robot in robots]
    result = run("dispense", seed, schedule=schedule, timeout_us=90 * SECOND_US)
    assert result.violations == []
    assert result.exclusive_done_twice == 0
    assert result.summary["faults"] == [] or "is_locked" in how
    if robots == DOSERS and how == {"fails": True}:
        doses = [span for span in spans(result.events) if span.local_task == "dose"]
        assert min(span.start_s for span in doses) > 8
