"""How far one robot that lies can drive the numbers that others continue."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.records import (
    Attempt,
    ConditionValue,
    ExpressionChanges,
    Record,
)
from mrbt_mesh.core.facts.stamps import MAX_CHANGES_AHEAD, MAX_STAMPS_AHEAD, Stamps
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.values import MAX_STAMP
from mrbt_mesh.core.membership.replica import TOO_FAR_AHEAD, Replica
from mrbt_mesh.core.membership.timing import Timing
from mrbt_mesh.core.membership.wire import Header
from mrbt_mesh.features.revisions.facts import Revisions
from mrbt_mesh.features.revisions.records import HeldMission
from tests.support import build
from tests.support.build import RUN, action, condition, fallback, sequence

ROBOTS = ("A", "B", "LIAR")


@given(st.lists(st.sampled_from(ROBOTS), max_size=60), st.randoms(use_true_random=False))
def test_a_liar_drives_the_stamps_of_others_by_a_bounded_step(writers: list[str], dice) -> None:  # type: ignore[no-untyped-def]
    """Every fact reaches everybody at once; the liar takes any stamp that it likes."""
    seen = {robot: Stamps(robot) for robot in ROBOTS}
    greatest = honest = 0
    for writer in writers:
        stamp = seen[writer].greatest + 1
        if writer == "LIAR":
            stamp = dice.choice([stamp, MAX_STAMP, 0, stamp + MAX_STAMPS_AHEAD])
        else:
            honest += 1
            greatest = max(greatest, stamp)
        for each in seen.values():
            each.see(writer, stamp)
    assert greatest <= honest * (MAX_STAMPS_AHEAD + 1)


def test_honest_robots_continue_from_the_greatest_stamp() -> None:
    stamps = Stamps("A")
    for author, stamp in (("B", 7), ("C", 900), ("A", 3)):
        stamps.see(author, stamp)
    assert stamps.greatest == 900


def test_a_robot_alone_continues_its_own_stamps() -> None:
    stamps = Stamps("A")
    stamps.see("A", 3 * MAX_STAMPS_AHEAD)
    assert stamps.greatest == 3 * MAX_STAMPS_AHEAD


MISSION = build.make_mission(sequence(fallback(condition("c1"), condition("c2")), action("a")))


def replica(robot: str) -> Replica:
    header = Header(MISSION.team_digest[:16], MISSION.name, RUN, robot)
    return Replica(TeamFacts(MISSION, RUN, robot), header, Timing(), "n")


class Team:
    """Replicas that hear one another's facts at once."""

    def __init__(self, *robots: str) -> None:
        self.replicas = {robot: replica(robot) for robot in robots}

    def write(self, author: str, name: str, record: Record, *to: str) -> list[str]:
        """The reasons why some of those that hear it (all, if `to` is empty) refuse it."""
        data, _ = self.replicas[author].write([(name, record)], 0)
        heard = (robot for robot in to or self.replicas if robot != author)
        return [self.replicas[r].receive(author, data, 0).reason for r in heard]

    def change(self, author: str) -> list[str]:
        """An honest robot sees the condition change."""
        facts = self.replicas[author].facts
        changes = facts.conditions.changes("c1") + 1
        changed = ConditionValue(bool(changes % 2), changes, facts.max_stamp + 1)
        return self.write(author, "condition/c1", changed)


def lie(changes: int) -> ConditionValue:
    return ConditionValue(bool(changes % 2), changes, 1)


@pytest.mark.parametrize("changes", [MAX_STAMP, MAX_STAMP - 1, MAX_CHANGES_AHEAD + 1])
def test_a_count_of_changes_that_nobody_could_continue_is_refused(changes: int) -> None:
    team = Team(*ROBOTS)
    assert set(team.write("LIAR", "condition/c1", lie(changes))) == {TOO_FAR_AHEAD}
    assert set(team.change("A")) == {""}
    assert team.replicas["B"].facts.condition("c1")


def test_honest_robots_that_correct_a_lie_are_not_refused_by_those_that_missed_it() -> None:
    """The liar takes its word back, and a robot that was cut off hears of it last."""
    team = Team(*ROBOTS)
    for _ in range(3):
        known = team.replicas["A"].facts.conditions.changes("c1")
        team.write("LIAR", "condition/c1", lie(known + MAX_CHANGES_AHEAD), "A")
        changes = team.replicas["A"].facts.conditions.changes("c1")
        assert changes > known
        team.write("A", "condition/c1", lie(changes + 1), "LIAR")
    team.write("LIAR", "condition/c1", lie(1), "A")
    late, known_at = team.replicas["B"], team.replicas["A"]
    for _ in range(2):  # what is refused at first is asked for again
        for page in known_at.answer_pull(late.write_pull()):
            late.receive_state("A", page, 0)
    assert late.facts.map.digest() == known_at.facts.map.digest()
    assert late.facts.conditions.changes("c1") == known_at.facts.conditions.changes("c1")


def test_no_author_takes_back_a_revision() -> None:
    team = Team("A", "B")
    team.write("A", "condition/c1", lie(5))
    team.write("A", "condition/c1", lie(4))
    assert team.replicas["B"].facts.conditions.changes("c1") == 5


@pytest.mark.parametrize("read", [(MAX_STAMP, 0), (0, 9), (9, 9)])
def test_a_guard_goes_on_although_somebody_claims_to_have_read_later_conditions(
    read: tuple[int, int],
) -> None:
    team = Team(*ROBOTS)
    value = bool(read[0] % 2) or bool(read[1] % 2)
    team.write("LIAR", "expression/#1", ExpressionChanges(1 if value else 2, read))
    facts = team.replicas["A"].facts
    assert facts.turns("#1", True) == 0
    team.change("B")
    assert facts.turned_guards() == [("#1", ExpressionChanges(1, (1, 0)))]


def test_the_next_number_of_a_revision_is_not_one_that_a_single_robot_claims() -> None:
    team = Team(*ROBOTS)
    team.write("LIAR", "mission_held", HeldMission(MAX_STAMP, "", "", 0))
    assert team.replicas["A"].facts.index(Revisions).last_number == 0
    for robot in ("A", "B"):
        team.write(robot, "mission_held", HeldMission(3, "", "", 3))
    assert team.replicas["A"].facts.index(Revisions).last_number == 3


def test_a_robot_does_not_write_what_others_and_its_own_journal_would_refuse() -> None:
    team = Team("A", "B")
    held = HeldMission(0, "", "", 0)
    data, entries = team.replicas["A"].write(
        [("condition/c1", lie(MAX_STAMP + 1)), ("mission_held", held)], 0
    )
    assert [each.record for each in entries] == [held]
    assert len(team.replicas["A"].left_out) == 1
    assert not team.replicas["B"].receive("A", data, 0).refused


LOOP = build.make_mission(build.repeat(-1, action("a")))


def loops(*robots: str) -> tuple[Team, str]:
    """Replicas of a mission that repeats an action for ever, and its loop's activation."""
    team = Team(*robots)
    for robot in robots:
        header = Header(LOOP.team_digest[:16], LOOP.name, RUN, robot)
        team.replicas[robot] = Replica(TeamFacts(LOOP, RUN, robot), header, Timing(), "n")
    facts = team.replicas["A"].facts
    return team, str(facts.mission.evaluator.activation(0, [], facts))


def request(facts: TeamFacts) -> str:
    (asked,) = facts.mission.evaluator.evaluate(facts).requests
    return asked.activation


@pytest.mark.parametrize("number", [MAX_STAMP, MAX_STAMP - 1, MAX_CHANGES_AHEAD + 1])
def test_attempts_that_cannot_have_been_are_refused(number: int) -> None:
    team, loop = loops(*ROBOTS)
    before = request(team.replicas["B"].facts)
    name = f"attempt/{loop}"
    assert set(team.write("LIAR", name, Attempt(number))) == {TOO_FAR_AHEAD}
    assert request(team.replicas["B"].facts) == before
    assert set(team.write("A", name, Attempt(1))) == {""}
    assert request(team.replicas["B"].facts) != before


def test_attempts_that_honest_robots_continue_reach_those_that_missed_some() -> None:
    team, loop = loops(*ROBOTS)
    name, known_at, late = f"attempt/{loop}", team.replicas["A"], team.replicas["B"]
    for _ in range(3):
        used = known_at.facts.attempts_used(loop)
        team.write("LIAR", name, Attempt(used + MAX_CHANGES_AHEAD), "A")
        assert known_at.facts.attempts_used(loop) > used
        team.write("A", name, Attempt(known_at.facts.attempts_used(loop) + 1), "LIAR")
    for _ in range(2):  # what is refused at first is asked for again
        for page in known_at.answer_pull(late.write_pull()):
            late.receive_state("A", page, 0)
    assert late.facts.map.digest() == known_at.facts.map.digest()
