"""What the judge finds in recorded events, journals and injected faults."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.facts.records import OUTCOME
from mrbt_mesh.core.facts.store import Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.peer import State
from mrbt_mesh.drills.beside import Check
from mrbt_mesh.drills.inject import InjectedFault, InjectedFaults, JournalsAtDeath
from mrbt_mesh.drills.journals import Done, read
from mrbt_mesh.drills.judge import DrillResult, Evidence, judge, unjournaled
from mrbt_mesh.drills.links import LinkLine, read_links
from mrbt_mesh.drills.model import ExpectModel
from mrbt_mesh.drills.physical import FreezeSpan, moving, read_events, spans
from mrbt_mesh.runtime.journal import Journal
from mrbt_mesh.sim import Kill
from tests.support.runs import example, run_example

MISSION, _ = example("vehicle_repair")
PIDS = {"A1": 11, "A2": 12, "B1": 21, "C1": 31, "C2": 32}


def event(
    t: float, robot: str, what: str, local_task: str, *args: str, pid: int = 0, act: str = "x"
) -> dict[str, Any]:
    """One line of events.jsonl; `what` is start, cancel, success or failure."""
    return {
        "t": t,
        "robot": robot,
        "pid": pid or PIDS[robot],
        "incarnation": "1.n",
        "event": what if what in ("start", "cancel") else "end",
        "outcome": None if what in ("start", "cancel") else what,
        "activation": act,
        "global_task": {"replace_hw": "fix_hw(2)", "move_frame": "remove_cover"}[local_task],
        "local_task": local_task,
        "args": list(args),
    }


KILLED_AT_WORK = [
    event(1.0, "A1", "start", "replace_hw", "2"),
    event(2.0, "B1", "start", "replace_hw", "2"),
    event(4.0, "B1", "success", "replace_hw", "2"),
]


def results(evidence: Evidence, **expect: Any) -> list[DrillResult]:
    """Those on what a test expects; the three that are always there come first and must hold."""
    found = judge(ExpectModel.model_validate(expect), MISSION, evidence)
    assert all(each.holds for each in found[:3])
    return found[3:]


def one(evidence: Evidence, **expect: Any) -> DrillResult:
    (found,) = results(evidence, **expect)
    return found


def test_the_result_and_the_steps_are_always_judged() -> None:
    evidence = Evidence("timeout", ended_because="not over after 60 s", steps_left=["step 2 of 2"])
    evidence.injected.problems.append("kill: A1 had no process any more")
    evidence.crashes.append("C1 ended with status 1: KeyError: 3")
    result, steps, crashes = judge(ExpectModel(), MISSION, evidence)
    assert crashes == DrillResult(
        "no robot ended by an error", False, "C1 ended with status 1: KeyError: 3"
    )
    assert result == DrillResult("result success", False, "timeout (not over after 60 s)")
    assert not steps.holds
    assert "step 2 of 2: its moment never came; kill: A1 had no process" in steps.found


@pytest.mark.parametrize(
    ("bounds", "holds"),
    [
        ({"times": 1}, True),
        ({"times": 2}, False),
        ({"at_least": 1}, True),
        ({"at_most": 0}, False),
        ({"at_least": 2, "at_most": 3}, False),
    ],
)
def test_only_successes_count_as_done(bounds: dict[str, int], holds: bool) -> None:
    for name in ("replace_hw(2)", "replace_hw"):
        evidence = Evidence("success", events=KILLED_AT_WORK)
        found = one(evidence, done=[{"local_task": name, **bounds}])
        assert (found.holds, found.found) == (holds, "1 (B1)")


def test_a_task_that_nobody_started_was_not_done_once() -> None:
    found = one(Evidence("success"), done=[{"local_task": "replace_hw", "times": 1}])
    assert (found.holds, found.found) == (False, "0")


def test_done_may_be_asked_for_one_global_task() -> None:
    evidence = Evidence("success", events=KILLED_AT_WORK)
    expect = {"local_task": "replace_hw(2)", "global_task": "fix_hw(4)", "times": 0}
    assert one(evidence, done=[expect]).holds


def test_a_dead_robot_works_no_longer_than_its_process_lived() -> None:
    never = [{"local_task": "replace_hw(2)"}]
    without = Evidence("success", events=KILLED_AT_WORK)
    assert one(without, never=never) == DrillResult(
        "never more than 1 at replace_hw(2)", False, "at most 2"
    )
    injected = InjectedFaults(deaths={PIDS["A1"]: 1.9})
    assert one(Evidence("success", injected, events=KILLED_AT_WORK), never=never).holds
    injected = InjectedFaults(deaths={PIDS["A1"]: 2.1})
    evidence = Evidence("success", injected, events=KILLED_AT_WORK)
    assert not one(evidence, never=never).holds
    # Both are at it for 0.1 s.
    assert one(evidence, never=[never[0] | {"overlap_s": 0.15}]).holds
    assert not one(evidence, never=[never[0] | {"overlap_s": 0.05}]).holds


def frozen(end: str) -> Evidence:
    events = [
        event(1.0, "A1", "start", "replace_hw", "2"),
        event(2.0, "B1", "start", "replace_hw", "2"),
        event(3.1, "A1", end, "replace_hw", "2"),
        event(4.0, "B1", "success", "replace_hw", "2"),
    ]
    injected = InjectedFaults(freezes=[FreezeSpan(PIDS["A1"], 1.5, 3.0)])
    injected.fault_log.thawed.append("A1")
    return Evidence("success", injected, events=events)


def test_a_thawed_robot_must_cancel_what_it_was_doing() -> None:
    expect: dict[str, Any] = {"yields": {"thawed": None}, "never": [{"local_task": "replace_hw"}]}
    never, yields = results(frozen("cancel"), **expect)
    assert never.holds
    assert yields == DrillResult("A1 yields when it wakes", True, "replace_hw(2): cancel")
    never, yields = results(frozen("success"), **expect)
    assert not never.holds
    assert yields == DrillResult("A1 yields when it wakes", False, "replace_hw(2): success")


def test_a_robot_that_did_nothing_has_nothing_to_yield() -> None:
    evidence = Evidence("success", InjectedFaults(freezes=[FreezeSpan(PIDS["A1"], 1.5, 3.0)]))
    assert one(evidence, yields="A1") == DrillResult(
        "A1 yields when it wakes", False, "it did nothing"
    )


def test_a_frozen_execution_has_a_gap() -> None:
    (span,) = spans(
        [event(1, "A1", "start", "move_frame"), event(9, "A1", "success", "move_frame")]
    )
    freezes = [
        FreezeSpan(PIDS["A1"], 2, 3),
        FreezeSpan(PIDS["A1"], 5, 6),
        FreezeSpan(PIDS["B1"], 1, 9),
    ]
    assert [(p.start_s, p.end_s) for p in moving(span, freezes)] == [(1, 2), (3, 5), (6, 9)]


def test_states_at_the_end() -> None:
    states = {"A1": State.DEAD, "B1": State.SUSPECT, "C1": State.LEFT}
    evidence = Evidence("success", states=states)
    found = results(evidence, dead="A1", alive=["B1"], left="C1")
    assert [v.holds for v in found] == [True, True, True]
    found = results(evidence, dead=["A1", "B1"], alive=["A2"], left={"killed": None})
    assert [v.holds for v in found] == [False, False, False]


def takeover(robot: str, inflicted: bool, **more: Any) -> dict[str, Any]:
    given = {"at_s": 1.0, "detected_s": 0.02, "reassigned_s": 0.03, "held": "replace_hw(2)"}
    flags = {"inflicted": inflicted, "ended": inflicted, "replacement": "B1"}
    return {"robot": robot, **flags, **given, **more}


def test_times_of_what_the_drill_did_and_deaths_that_it_did_not_cause() -> None:
    expect = {"detected_within_s": 1, "takeover_within_s": 1, "false_deaths": 0}
    good = Evidence("success", takeovers=[takeover("A1", True)])
    assert [v.holds for v in results(good, **expect)] == [True, True, True]
    slow = Evidence("success", takeovers=[takeover("A1", True, detected_s=2.0, reassigned_s=None)])
    assert [v.holds for v in results(slow, **expect)] == [False, False, True]
    idle = Evidence("success", takeovers=[takeover("A1", True, held=None, reassigned_s=None)])
    assert [v.holds for v in results(idle, **expect)] == [True, False, True]
    false = Evidence("success", takeovers=[takeover("A1", True), takeover("C1", False)])
    assert [v.holds for v in results(false, **expect)] == [True, True, False]
    gone = Evidence("success", takeovers=[takeover("A1", True), takeover("C1", False, ended=True)])
    assert [v.holds for v in results(gone, **expect)] == [True, True, True]


def test_robots_that_were_hit_are_those_whose_processes_suffered() -> None:
    done = [
        InjectedFault(0, 0.0, fault, (robot,), "")
        for fault, robot in (("kill", "A1"), ("stop", "B1"), ("join", "C2"), ("block", "C1"))
    ]
    assert InjectedFaults(done=done).hit() == {"A1", "B1"}


# -- links --------------------------------------------------------------------------------


def link(unix_s: float, robot: str, peer: str, *, back: bool) -> LinkLine:
    return LinkLine(unix_s, robot, peer, "link_heard" if back else "link_silent")


def test_a_thawed_robot_that_goes_on_before_it_gives_up_works_all_that_time() -> None:
    """Its program did not take the cancellation for three seconds."""
    for stops_s, most in ((7.2, 1), (10.0, 2)):
        events = [
            event(1.0, "A1", "start", "replace_hw", "2"),
            event(5.0, "B1", "start", "replace_hw", "2"),
            event(stops_s, "A1", "cancel", "replace_hw", "2"),
            event(11.0, "B1", "success", "replace_hw", "2"),
        ]
        injected = InjectedFaults(freezes=[FreezeSpan(PIDS["A1"], 2.0, 7.0)])
        evidence = Evidence("success", injected, events=sorted(events, key=lambda each: each["t"]))
        assert one(evidence, never=NEVER).found == f"at most {most}"


NEVER = [{"local_task": "replace_hw(2)"}]


def test_absence_holds_only_where_something_was_observed() -> None:
    """Nothing was started, nothing was journaled, nobody was seen: that proves nothing."""
    found = results(Evidence("success"), never=NEVER, repeated=0, false_deaths=0, stalls=0)
    assert [(each.holds, each.found) for each in found] == [
        (False, "nothing was recorded for replace_hw(2)"),
        (False, "nothing was recorded for any local task"),
        (False, "no journal was read"),
        (False, "no robot was seen"),
        (False, "no robot has a log"),
    ]


def test_absence_does_not_hold_where_a_robot_did_not_record() -> None:
    injected = InjectedFaults(deaths={PIDS["A1"]: 1.5})
    evidence = Evidence("success", injected, events=KILLED_AT_WORK, unrecorded={"B1"})
    found = one(evidence, never=NEVER)
    assert (found.holds, found.found) == (False, "not all was recorded by B1")


def cut_until(healed_s: float, *links: LinkLine, disturbed: str = "A1 B1") -> Evidence:
    heal = InjectedFault(0, healed_s, "heal", (), "")
    injected = InjectedFaults(done=[heal], disturbed={frozenset(disturbed.split())})
    return Evidence("success", injected, links=list(links))


def test_links_come_back_in_time_or_not() -> None:
    lost = (link(3, "A1", "B1", back=False), link(3, "B1", "A1", back=False))
    both = (link(6, "A1", "B1", back=True), link(6.5, "B1", "A1", back=True))
    (good,) = results(cut_until(5, *lost, *both), links_back_within_s=2)
    assert (good.holds, good.found) == (True, "2 links came back")
    (late,) = results(cut_until(5, *lost, *both), links_back_within_s=1.2)
    assert (late.holds, late.found) == (False, "B1 heard A1 after 1.5 s")
    (never,) = results(cut_until(5, *lost, both[0]), links_back_within_s=2)
    assert (never.holds, never.found) == (False, "B1 hears A1 no more")
    unneeded = LinkLine(7, "B1", "A1", "link_unwatched")
    (other,) = results(cut_until(5, *lost, both[0], unneeded), links_back_within_s=2)
    assert (other.holds, other.found) == (True, "1 links came back"), "A1 is not a neighbour now"
    (idle,) = results(cut_until(5), links_back_within_s=2)
    assert (idle.holds, idle.found) == (False, "no link was lost")


def test_links_of_robots_that_were_stopped_are_nobodys_fault() -> None:
    evidence = cut_until(5, link(3, "A1", "C1", back=False), link(6, "A1", "B1", back=True))
    assert [v.holds for v in results(evidence, links_back_within_s=2, stalls=0)] == [False, False]
    evidence.injected.done.append(InjectedFault(0, 2.0, "kill", ("C1",), ""))
    assert [v.holds for v in results(evidence, links_back_within_s=2, stalls=0)] == [True, True]


def test_only_links_that_nobody_disturbed_can_stall() -> None:
    silent = (link(3, "A1", "B1", back=False), link(3, "B1", "C1", back=False))
    (stalled,) = results(cut_until(5, *silent), stalls=0)
    assert (stalled.holds, stalled.found) == (False, "B1 did not hear C1")
    assert [v.holds for v in results(cut_until(5, *silent), stalls=1)] == [True]
    cut = cut_until(5, *silent[1:], disturbed="B1 C1")
    assert [v.holds for v in results(cut, stalls=0)] == [True]


def test_link_lines_are_read_from_logs(tmp_path: Path) -> None:
    (tmp_path / "A1.log").write_text(
        '{"event": "joined", "timestamp": "2026-01-01T00:00:00Z"}\n'
        '{"event": "link_silent", "peer": "B1", "timestamp": "2026-01-01T00:00:02.5Z"}\n'
        '{"event": "link_heard", "peer": "B1", "timestamp": "2026-01-01T00:00:09Z"}\n'
        '{"event": "link_si'
    )
    (tmp_path / "B1.log").write_text(
        '{"event": "link_silent", "peer": "A1", "timestamp": "2026-01-01T00:00:04Z"}\n'
    )
    start_s = datetime(2026, 1, 1, tzinfo=UTC).timestamp()
    found = [(x.unix_s - start_s, x.robot, x.peer, x.back) for x in read_links(tmp_path, PIDS)]
    assert found == [(2.5, "A1", "B1", False), (4, "B1", "A1", False), (9, "A1", "B1", True)]


# -- journals -----------------------------------------------------------------------------

COVER = [
    event(1.0, "C1", "start", "move_frame"),
    event(1.0, "C2", "start", "move_frame"),
    event(2.0, "C1", "success", "move_frame"),
]
C1_DONE = Done("C1", "x", "move_frame")
C2_DONE = Done("C2", "x", "move_frame")


def killed(held: set[Done], kept: set[Done], *after: dict[str, Any]) -> Evidence:
    """The team is killed at 3 with `held` in C1's journal; in the end it holds `kept`."""
    injected = InjectedFaults(
        journals_at_death=[JournalsAtDeath(3.0, {"C1": frozenset(held), "C2": frozenset()})]
    )
    journals = {"C1": frozenset(kept)}
    return Evidence("success", injected, events=[*COVER, *after], journals=journals)


def test_what_a_partner_still_has_to_do_is_no_repetition() -> None:
    """move_frame needs two: one success does not end it."""
    restarted = event(4.0, "C2", "start", "move_frame", pid=99)
    repeated, lost = results(killed({C1_DONE}, {C1_DONE}, restarted), repeated=0)
    assert repeated.holds
    assert lost.holds


def test_a_robot_that_does_again_what_it_had_journaled_repeats() -> None:
    again = event(4.0, "C1", "start", "move_frame", pid=99)
    repeated, _ = results(killed({C1_DONE}, {C1_DONE}, again), repeated=0)
    assert repeated == DrillResult("nothing repeated", False, "move_frame by C1")
    repeated, _ = results(killed({C1_DONE}, {C1_DONE}, again), repeated=1)
    assert repeated.holds
    repeated, _ = results(killed(set(), set(), again), repeated=0)
    assert repeated.holds, "it was not journaled"


def test_anybody_who_does_again_what_as_many_as_needed_had_done_repeats() -> None:
    again = event(4.0, "A1", "start", "move_frame", pid=99)
    both = {C1_DONE, C2_DONE}
    repeated, _ = results(killed(both, both, again), repeated=0)
    assert not repeated.holds
    other = event(4.0, "A1", "start", "move_frame", pid=99, act="another")
    repeated, _ = results(killed(both, both, other), repeated=0)
    assert repeated.holds


def test_successes_of_different_coalitions_do_not_add_up() -> None:
    """Who was in a coalition that broke does it again with the next one."""
    again = event(4.0, "C1", "start", "move_frame", pid=99)
    apart = {Done("C1", "x", "move_frame", "t1"), Done("C2", "x", "move_frame", "t2")}
    repeated, _ = results(killed(apart, apart, again), repeated=0)
    assert repeated.holds
    together = {Done("C1", "x", "move_frame", "t1"), Done("C2", "x", "move_frame", "t1")}
    repeated, _ = results(killed(together, together, again), repeated=0)
    assert not repeated.holds


def test_a_journaled_success_that_is_gone_is_lost() -> None:
    _, lost = results(killed({C1_DONE, C2_DONE}, {C1_DONE}), repeated=0)
    assert lost == DrillResult("nothing journaled is lost", False, "move_frame by C2")
    forgotten = killed({C1_DONE, C2_DONE}, {C1_DONE})
    forgotten.is_obsolete = lambda activation: activation == "x"
    _, lost = results(forgotten, repeated=0)
    assert lost.holds


def test_what_ended_in_the_world_and_not_in_the_journal() -> None:
    evidence = killed({C1_DONE}, {C1_DONE})
    assert unjournaled(spans(evidence.events), evidence.injected) == []
    evidence = killed(set(), set())
    twice = JournalsAtDeath(5.0, {"C1": frozenset(), "C2": frozenset()})
    evidence.injected.journals_at_death.append(twice)
    (span,) = unjournaled(spans(evidence.events), evidence.injected)
    assert (span.robot, span.ground) == ("C1", "move_frame")


def test_journals_are_read_from_copies(tmp_path: Path) -> None:
    def log(level: str, event: str, **fields: Any) -> None:
        raise AssertionError(event)

    journal = Journal(tmp_path / "C1.journal", "digest", "run", "C1", log)
    journal.open()
    version = Version(Incarnation(1, "n"), 1)
    entries = [
        parse_entry(robot, f"{OUTCOME}/x/move_frame", version, [success, None])
        for robot, success in (("C1", True), ("C2", False))
    ]
    # The names of a coalition's outcomes end with the coalition.
    together = parse_entry("C2", f"{OUTCOME}/y/move_frame/t1", version, [True, None])
    journal.write({(each.author, each.name): each for each in [*entries, together]})
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert any(name.endswith("-wal") for name in before), "not yet in the main file"
    held = read(tmp_path, ["C1", "C2"], "digest", "run")
    assert held == {"C1": {C1_DONE, Done("C2", "y", "move_frame", "t1")}, "C2": frozenset()}
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    journal.close()


# -- events -------------------------------------------------------------------------------


def test_a_half_written_line_is_left_for_later(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    assert read_events(path) == []
    path.write_text('{"a": 1}\n{"b"')
    assert read_events(path) == [{"a": 1}]


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ([event(1, "A1", "start", "move_frame")] * 2, "started twice"),
        ([event(1, "A1", "success", "move_frame")], "ended without a start"),
    ],
)
def test_records_that_no_robot_writes(events: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spans(events)


def test_a_simulated_run_with_a_kill_is_judged_like_a_real_one() -> None:
    seen = run_example("vehicle_repair", 5, schedule=[(13_000_000, Kill("A1"))])
    pid = next(e["pid"] for e in seen.events if e["robot"] == "A1")
    dead = spans(seen.events)
    killed_s = next(s.start_s for s in dead if s.robot == "A1" and s.end is None) + 0.5
    takeovers = [t | {"inflicted": True} for t in seen.summary["takeovers"]]
    evidence = Evidence("success", InjectedFaults(deaths={pid: killed_s}), takeovers=takeovers)
    evidence.events = seen.events
    done = [{"local_task": "do_diagnosis", "times": 1}, {"local_task": "replace_hw", "times": 1}]
    never = [{"local_task": "replace_hw"}]
    found = results(evidence, done=done, never=never, takeover_within_s=2)
    assert [v for v in found if not v.holds] == []
    assert len(found) == 5 + 2 + 2 + 1


def test_what_was_asked_beside_the_team_decides_as_well() -> None:
    asked = [Check("python world.py --judge", 0, "mended"), Check("true", None, "no answer")]
    ended = ["python world.py has ended with status 1: no model"]
    found = results(Evidence("success", checks=asked, beside_ended=ended))
    assert found == [
        DrillResult("beside the team until its end", False, ended[0]),
        DrillResult("python world.py --judge", True, "mended"),
        DrillResult("true", False, "no answer"),
    ]
