"""What every screen says of a team, the worst first."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrbt_mesh.core.facts.records import AdoptedMission, HeldMission
from mrbt_mesh.core.facts.store import Incarnation, Version, make_entry
from mrbt_mesh.core.mission.compiled import compile_mission
from mrbt_mesh.core.mission.revisions import revise
from mrbt_mesh.core.observer.episodes import after_text
from mrbt_mesh.core.observer.headline import headline, robots_that_differ
from mrbt_mesh.core.observer.observer import Observer
from tests.support.commands import command
from tests.support.watched import ALONE, COVER, WELD, watched


def said(observer: Observer) -> list[str]:
    """The headline; times without their digits."""
    statements = headline(observer, ())
    return [f"{each.level} {each.text}".split(" after ")[0] for each in statements]


def test_a_team_at_work() -> None:
    _, observer = watched(WELD)
    assert said(observer) == ["good running", "good all 2 agree"]
    assert robots_that_differ(observer) == []
    odd = headline(observer, ["B", "A"])
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
    assert headline(observer, ())[0].text.endswith(f"after {after}")


def test_an_observer_that_came_later_does_not_claim_a_replacement() -> None:
    _, observer = watched(COVER, "kill A", "pass 100")
    observer.record.major[0].is_older = True
    assert said(observer)[0] == "warn 1 dead: A, B has weld"


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


def test_all_are_dead() -> None:
    script, observer = watched(WELD, "kill A", "kill B", "pass 8000")
    observer.update(script.team.now_us)
    assert said(observer) == ["bad no robot is heard", "bad 2 dead: A, B, 1 not replaced yet"]


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
