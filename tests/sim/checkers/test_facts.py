"""I2, I3 and I8: facts agree, nothing is undone, garbage changes nothing."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.effects import Log
from mrbt_mesh.core.agent.inputs import CapabilityChanged, TimerFired
from mrbt_mesh.core.facts.records import OUTCOME
from mrbt_mesh.core.membership.peer import State
from tests.support.checked_team import SECOND_US, Team, start


def test_i2_facts_that_stay_different(team: Team) -> None:
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    assert "I2" in team.sample()
    assert "differ" in team.checkers.violations[0]


def test_i2_waits_until_the_network_is_quiet(team: Team) -> None:
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    team.checkers.run.changed_us = team.clock.now_us - SECOND_US
    assert team.sample() == []


def test_i2_views_of_the_living_that_stay_different(team: Team) -> None:
    membership = team.agents[0]._context.membership
    membership._set("B1", membership.peers["B1"], State.DEAD)
    assert "I2" in team.sample()
    assert "alive" in team.checkers.violations[0]


def test_i2_nobody_is_held_for_dead_who_is_heard(team: Team) -> None:
    process: Any = team.processes[0]

    def declared_dead(robot: str) -> list[str]:
        team.checkers.violations.clear()
        log = Log("warning", "robot_dead", {"robot": robot})
        team.checkers.handling(process, TimerFired())
        team.checkers.handled(process, TimerFired(), [log])
        return [text.partition(": ")[2] for text in team.checkers.violations]

    text = "A1 holds B1 for dead, which"
    others = [f"{text} {other} hears" for other in ("A2", "B2", "C2")]
    assert declared_dead("B1") == [f"{text} it hears", *others]
    assert declared_dead("C1") == []
    team.network.blocked = {("B1", "A1"), ("B1", "A2"), ("B2", "A1")}
    assert declared_dead("B1") == [f"{text} C2 hears"]
    # A link that has just come back, or a fault of another kind: give it time.
    team.checkers.run.fault_came([("B1", "C2")])
    assert declared_dead("B1") == []
    team.network.blocked = set()
    team.checkers.run.fault_came()
    assert declared_dead("B1") == []


def test_i3_an_outcome_that_is_lost_and_a_task_that_is_undone(team: Team) -> None:
    assert team.sample() == []
    facts = team.agents[0].view.facts.map
    for entry in [entry for entry in facts if entry.name.startswith(OUTCOME)]:
        facts.drop(entry.author, entry.name)
    assert "I3" in team.sample()
    lost = [text for text in team.checkers.violations if text.startswith("I3")]
    assert any("has lost" in text for text in lost)
    assert any("is not finished any more" in text for text in lost)


def test_i3_work_that_is_started_although_it_is_done(team: Team) -> None:
    assert start(team, "C2", "remove_screws", "use_screwdriver") == ["I3"]


def test_i8_input_that_leaves_a_trace(team: Team) -> None:
    team.clock.now_us = 9 * SECOND_US + 1
    process: Any = team.processes[0]
    team.checkers.garbage(process, TimerFired())
    assert team.checkers.violations == []
    team.checkers.garbage(process, CapabilityChanged("replace_hw", lost=True))
    assert team.checkers.violations[0].startswith("I8")


def test_i2_what_somebody_held_long_ago_and_another_still_lacks(team: Team) -> None:
    """Also where new facts keep coming, so that the digests never have to be equal."""
    facts = team.agents[0].view.facts.map
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    facts.drop(entry.author, entry.name)
    for _ in range(40):
        team.clock.now_us += SECOND_US // 5
        team.checkers.run.changed_us = team.clock.now_us
        team.checkers.sample()
    lacking = [text for text in team.checkers.violations if text.startswith("I2")]
    assert lacking
    assert all(f"A1 still lacks {entry.name}" in text for text in lacking)
