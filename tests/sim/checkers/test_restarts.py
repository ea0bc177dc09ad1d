"""I9: what was told is kept over a restart."""

from __future__ import annotations

from typing import Any

from mrbt_mesh.core.agent.effects import Forget, Persist, Publish, StartAction
from mrbt_mesh.core.agent.inputs import JournalOpened, TimerFired
from mrbt_mesh.core.facts.records import OUTCOME, RobotProblem
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.membership.wire import MessageKind
from tests.support import inside
from tests.support.checked_team import Team

TICK = TimerFired()


def test_i9_what_was_synced_is_known_after_a_restart(team: Team) -> None:
    process: Any = team.processes[0]
    facts, checker = process.agent.view.facts.map, team.checkers.i9
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    checker.synced(process, {(entry.author, entry.name): entry})
    checker.booted(process, process.agent.view)
    assert team.checkers.violations == []
    facts.drop(entry.author, entry.name)
    checker.booted(process, process.agent.view)
    assert "A1 had synced outcome/" in team.checkers.violations[0]
    # A robot whose disk is gone has synced nothing.
    team.checkers.violations.clear()
    checker.lost_journal("A1")
    checker.booted(process, process.agent.view)
    assert team.checkers.violations == []


def test_i9_what_could_not_be_read_at_first_is_known_once_it_can_be(team: Team) -> None:
    process: Any = team.processes[0]
    facts, checker = process.agent.view.facts.map, team.checkers.i9
    entry = next(entry for entry in facts if entry.name.startswith(OUTCOME))
    checker.synced(process, {(entry.author, entry.name): entry})
    facts.drop(entry.author, entry.name)
    process.has_read_journal = False
    checker.booted(process, process.agent.view)
    assert team.checkers.violations == []
    checker.handled(process, JournalOpened((entry,)), [])
    assert "A1 had synced outcome/" in team.checkers.violations[0]


def test_i9_only_what_nothing_can_reach_is_forgotten(team: Team) -> None:
    process: Any = team.processes[0]
    agent, checker = process.agent, team.checkers.i9
    entry = next(entry for entry in agent.view.facts.map if entry.name.startswith(OUTCOME))
    forget = Forget(((entry.author, entry.name),))
    checker.synced(process, {(entry.author, entry.name): entry})
    checker.handled(process, TICK, [forget])
    assert "A1 forgets outcome/" in team.checkers.violations[0]
    team.checkers.violations.clear()
    agent.view.facts.run = "another"  # to which the entry does not belong
    checker.handled(process, TICK, [forget])
    checker.synced(process, {(entry.author, entry.name): None})
    agent.view.facts.map.drop(entry.author, entry.name)
    checker.booted(process, agent.view)
    assert team.checkers.violations == []


def test_i9_no_version_has_two_contents(team: Team) -> None:
    process: Any = team.processes[0]
    version = Version(Incarnation(1, "n"), 1)
    for stamp in (3, 4):
        entry = parse_entry("A1", "problem/clock", version, str(stamp))
        team.checkers.i9.handled(process, TICK, [Persist((entry,), at_once=True)])
    assert "for two contents" in team.checkers.violations[0]


def note(process: Any, stamp: int) -> tuple[bytes, tuple[Entry, ...]]:
    """The message and the entries with which a robot notes a problem."""
    problem = RobotProblem(str(stamp))
    return inside.context(process.agent).replica.write([("problem/clock", problem)], 0)


def test_i9_what_a_robot_writes_stands(team: Team) -> None:
    """Unless an entry of an earlier life, with a higher incarnation, goes before it."""
    process: Any = team.processes[0]
    _, entries = note(process, stamp=9)
    team.checkers.i9.handled(process, TICK, [Persist(entries, at_once=True)])
    assert team.checkers.violations == []
    # A later one in the same step, which need not be on disk at once.
    _, newer = note(process, stamp=10)
    both = [Persist(entries, at_once=True), Persist(newer, at_once=False)]
    team.checkers.i9.handled(process, TICK, both)
    assert team.checkers.violations == []
    late = parse_entry("A1", "problem/clock", Version(Incarnation(0, "n"), 1), "11")
    team.checkers.i9.handled(process, TICK, [Persist((late,), at_once=True)])
    assert "A1 writes problem/clock" in team.checkers.violations[0]


def test_i9_nothing_is_published_before_the_journal_has_it_to_write(team: Team) -> None:
    process: Any = team.processes[0]
    data, entries = note(process, stamp=9)
    publish = Publish(MessageKind.FACT, data)
    team.checkers.i9.handled(process, TICK, [Persist(entries, at_once=True), publish])
    assert team.checkers.violations == []
    data, entries = note(process, stamp=10)
    publish = Publish(MessageKind.FACT, data)
    team.checkers.i9.handled(process, TICK, [publish, Persist(entries, at_once=True)])
    assert "A1 publishes problem/clock" in team.checkers.violations[0]


def test_i9_a_finished_local_task_that_is_begun_again(team: Team) -> None:
    process: Any = team.processes[-1]
    facts = process.agent.view.facts.map
    entry = next(e for e in facts if e.name.startswith(OUTCOME) and e.author == process.robot)
    _, activation, local_task = entry.name.split("/")
    team.checkers.i9.synced(process, {(entry.author, entry.name): entry})
    again = StartAction(9, activation, "remove_screws", local_task, (), 1, Incarnation(1, "n"))
    team.checkers.i9.handled(process, TICK, [again])
    assert "C2 starts outcome/" in team.checkers.violations[0]
