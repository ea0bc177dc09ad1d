"""What every screen says of a team, the worst first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.agent.inputs import CapabilityChanged
from mrbt_mesh.core.assignment.solvers import min_cost_flow
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.features.revisions.records import AdoptedMission, HeldMission
from mrbt_mesh.features.revisions.revise import revise
from mrbt_mesh.observer.episodes import after_text
from mrbt_mesh.observer.headline import headline, robots_that_differ
from mrbt_mesh.observer.observer import Observer, RunEnd
from tests.support.commands import command
from tests.support.watched import ALONE, COVER, WELD, watched


def said(observer: Observer) -> list[str]:
    """The headline; times without their digits."""
    statements = headline(observer, (), 0)
    return [f"{each.level} {each.text}".split(" after ")[0] for each in statements]


def test_a_team_at_work() -> None:
    _, observer = watched(WELD)
    assert said(observer) == ["good running", "good all 2 agree"]
    assert robots_that_differ(observer) == []
    odd = headline(observer, ["B", "A"], 0)
    assert [each.text for each in odd] == ["2 with another plan: A, B", "running"]


def test_before_anybody_is_heard() -> None:
    _, observer = watched(WELD[:-2])
    assert said(observer) == ["info waiting for robots"]


def test_a_death_whose_work_goes_on_is_a_warning_with_the_time_that_it_took() -> None:
    _, observer = watched(COVER, "kill A", "pass 100")
    assert said(observer) == ["warn 1 dead: A, replaced by B", "good running", "good all 2 agree"]
    (fault,) = observer.record.major
    assert fault.reassigned_after_us is not None
    after = after_text(fault.reassigned_after_us, exact=False)
    assert headline(observer, (), 0)[0].text.endswith(f"after {after}")


def test_an_observer_that_came_later_does_not_claim_a_replacement() -> None:
    _, observer = watched(COVER, "kill A", "pass 100")
    observer.record.major[0].is_older = True
    assert said(observer)[0] == "warn 1 dead: A, B has weld"


def test_a_takeover_whose_begin_nobody_has_seen_is_one_by_the_facts() -> None:
    _, observer = watched(COVER, "kill A", "pass 100")
    fault = observer.record.major[0]
    fault.is_older, fault.reassigned_us, fault.replacement = True, None, None
    assert said(observer)[0] == "warn 1 dead: A, B has weld"


def test_the_dead_are_all_replaced_only_if_each_of_them_is() -> None:
    script, observer = watched(WELD, "kill A", "kill B", "pass 8000")
    observer.update(script.team.now_us)
    worked, idle = observer.record.major
    worked.replacement = "C"
    assert idle.replacement is None
    assert said(observer)[1] == "warn 2 dead: A, B"
    idle.replacement = "C"
    assert said(observer)[1] == "warn 2 dead: A, B, all replaced"


def test_who_comes_late_says_who_has_done_the_work_of_the_dead() -> None:
    _, observer = watched(COVER, "kill A", "pass 100", "succeed B", "pass 300")
    fault = observer.record.major[0]
    fault.is_older, fault.reassigned_us, fault.replacement = True, None, None
    assert "warn 1 dead: A, weld was done by B" in said(observer)


def test_what_blocks_comes_first_with_the_robot_to_start() -> None:
    script, observer = watched(COVER, "succeed A", "pass 300", "kill B", "pass 1500")
    assert said(observer)[:2] == [
        "bad BLOCKED: cover: lift needs 2, 1 alive: start B (`mrbt join B`)",
        "bad 1 dead: B, lift is not replaced yet",
    ]
    script.block(["start B", "pass 1500"])
    assert said(observer) == ["good running", "good all 3 agree"]


def test_nobody_else_can_do_it() -> None:
    _, observer = watched(ALONE, "tell A fault weld", "pass 300")
    assert said(observer)[0] == (
        "bad BLOCKED: weld: weld needs 1, 0 alive: mend A (`mrbt fault A weld --end`)"
    )
    assert said(observer)[1:] == ["warn A lost weld: operator", "good all 2 agree"]


def test_a_fault_whose_end_the_robot_notices_is_not_to_be_ended_by_a_command() -> None:
    script, observer = watched(ALONE)
    lost = CapabilityChanged("weld", True, "the server does not answer", is_watched=True)
    script.team.give(script.team.processes["A"], lost)
    for words in ("pass 300", "tell A restore weld"):
        script.block([words, "pass 300"])
        assert said(observer)[0] == (
            "bad BLOCKED: weld: weld needs 1, 0 alive: mend A (the server does not answer)"
        )


@pytest.mark.parametrize(
    ("faults", "what"),
    [
        (["scan(b3)"], "'scan(b3)'"),
        (["scan"], "scan"),
        (["all"], "scan"),
        (["scan(b3)", "scan"], "scan"),
    ],
)
def test_the_command_that_ends_a_loss_names_what_was_lost(faults: list[str], what: str) -> None:
    team = (
        "robot A scan",
        "robot C look",
        "task scan scan(b3) 1..1",
        'tree "scan"',
        "observe",
        "start A C",
        "pass 200",
    )
    script, observer = watched(team, *(f"tell A fault {each}" for each in faults), "pass 300")
    assert f"mend A (`mrbt fault A {what} --end`)" in said(observer)[0]
    script.block([f"tell A restore {what.strip(chr(39))}", "pass 300"])
    assert "good running" in said(observer)


def test_an_exclusive_task_without_a_majority_names_whom_to_start() -> None:
    team = (
        "robot A walk pour",
        "robot B look",
        "robot C look",
        "robot D look",
        "task dose pour exclusive",
        'tree Sequence("walk", "dose")',
        "observe",
        "start A B C D",
        "pass 200",
    )
    script, observer = watched(team, "kill C", "kill D", "pass 1500", "succeed A", "pass 300")
    blocked = "bad BLOCKED: dose: exclusive: needs grants from 3 of 4 robots, 2 here: "
    assert said(observer)[0].replace(", start", ": start") == (
        f"{blocked}start C (`mrbt join C`) or start D (`mrbt join D`)"
    )
    script.block(["start C", "pass 1500"])
    assert "BLOCKED" not in said(observer)[0]


def test_all_are_dead() -> None:
    script, observer = watched(WELD, "kill A", "kill B", "pass 8000")
    observer.update(script.team.now_us)
    assert said(observer) == ["bad no robot is heard", "bad 2 dead: A, B, 1 not replaced yet"]


def test_robots_that_are_not_heard_but_run_are_silent() -> None:
    """All say the same: who has heard them before, and who has not."""
    script, observer = watched(WELD, "freeze A", "freeze B", "pass 8000")
    new = Observer(observer.mission, observer.facts.run, Timing(), min_cost_flow)
    new.update(script.team.now_us)
    assert said(new) == ["info waiting for robots"]
    for each in (observer, new):
        each.running = frozenset("AB")
        assert said(each) == ["bad no robot is heard", "warn 2 silent: A, B"]
    observer.running = frozenset("A")
    assert said(observer)[1:] == ["warn 1 dead: B, was idle", "warn 1 silent: A"]
    observer.running = frozenset("AB")
    script.block(["thaw A", "thaw B", "pass 3000"])
    assert said(observer) == ["good running", "good all 2 agree"]


def test_who_is_silent_and_declared_dead_by_others_is_dead() -> None:
    script, observer = watched(COVER, "freeze A", "pass 3000")
    observer.running = frozenset("ABC")
    assert any(each.startswith("warn 1 dead: A") for each in said(observer))
    script.block(["kill B", "kill C", "pass 8000"])
    observer.running = frozenset("A")
    assert "bad no robot is heard" in said(observer)


@pytest.mark.parametrize(
    ("what", "says"),
    [("paused pause", "paused: `mrbt resume` goes on"), ("aborted true", "failure")],
)
def test_commands(what: str, says: str) -> None:
    _, observer = watched(WELD, f"operate A {what}", "pass 300")
    assert says in said(observer)[0]


def test_a_revision_that_is_not_held_by_all_says_whom_it_waits_for() -> None:
    _, observer = watched(WELD)
    after = revise(observer.mission, observer.mission)
    held = HeldMission(1, after.digest, "", 0)
    facts = {
        ("B", "mission_held"): held,
    }
    proposed = command("mission/1", [compile_mission(after), False, False], operator="anna")
    observer.facts.map.merge([proposed])
    version = Version(Incarnation(9, "n"), 1)
    observer.facts.map.merge([make_entry(a, n, version, r) for (a, n), r in facts.items()])
    assert said(observer)[0] == (
        "warn revision 1 is proposed by anna, no robot begins anything: waiting for A "
        "(`mrbt revise --withdraw` ends it)"
    )
    adopted = AdoptedMission(after.digest)
    acts = replace(held, in_force=1)
    later = Version(Incarnation(9, "n"), 2)
    observer.facts.map.merge([make_entry("A", "mission_adopted/1", version, adopted)])
    observer.facts.map.merge([make_entry("B", "mission_held", later, acts)])
    assert said(observer)[0] == "warn revision 1 is in force, waiting for A"


def test_the_end_comes_with_the_robots_that_it_cost() -> None:
    _, observer = watched(WELD, "kill A", "pass 1500", "succeed B", "pass 300")
    assert said(observer) == ["good success", "warn 1 dead: A, replaced by B"]


def test_robots_that_do_not_record_are_named_in_one_line() -> None:
    script, observer = watched(COVER, "recording A ends", "recording B ends", "pass 100")
    line = "A, B: does not record: No space left on device"
    assert said(observer)[0] == f"warn {line}"
    script.block(["recording A works", "recording B works", "pass 100"])
    assert said(observer) == ["good running", "good all 3 agree"]


def test_a_run_of_which_no_robot_is_left_says_how_it_ended_until_it_is_continued() -> None:
    script, observer = watched(WELD, "leave A", "leave B", "pass 3000")
    assert said(observer)[0] == "bad no robot is heard"
    for end, words in (
        (RunEnd("ended", "ended by anna", 0), "info the run is over: ended by anna"),
        (
            RunEnd("blocked", "no robot is left", 0),
            "bad the run is over: blocked: no robot is left",
        ),
        (RunEnd("failure", "", 0), "bad the run is over: failure"),
    ):
        observer.ended = end
        assert said(observer) == [words]
        assert observer.is_over
    observer.ended = None
    script.block(["start A B", "pass 1000"])
    assert said(observer) == ["good running", "good all 2 agree"]
