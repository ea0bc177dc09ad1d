"""What a robot says of itself: capabilities lost and had again, performances that change."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.facts.description import OPERATOR, PROGRAM, Description
from mrbt_mesh.core.facts.records import MAX_CAPABILITIES, Member
from mrbt_mesh.core.facts.team_facts import capability
from mrbt_mesh.core.mission.failure_reasons import MAX_REASON
from mrbt_mesh.core.mission.mission import MAX_PERFORMANCE


def described(**capabilities: int) -> Description:
    """`weld` is a type; `cut_1` stands for `cut(1)`."""
    named = {name.replace("_1", "(1)"): value for name, value in capabilities.items()}
    return Description("R", "T", named, "", "", 0)


def member(description: Description) -> Member:
    return Member.parse(description.member(is_leaving=False).to_value())


def can(description: Description, local_task: str) -> int | None:
    return capability(member(description), local_task)


def test_a_performance_replaces_the_declared_one() -> None:
    robot = described(weld=10, look=10)
    assert robot.changes() == {"lost": {}}
    assert robot.perform("weld", 3) is None
    assert (can(robot, "weld"), can(robot, "weld(2)"), can(robot, "look")) == (3, 3, 10)
    assert robot.changes() == {"lost": {}, "performances": {"weld": 3e-06}}


def test_of_one_ground_local_task() -> None:
    robot = described(weld=10)
    assert robot.perform("weld(2)", 3) is None
    assert (can(robot, "weld(1)"), can(robot, "weld(2)")) == (10, 3)
    # What is told of the type holds for all of them.
    assert robot.perform("weld", 5) is None
    assert (can(robot, "weld(1)"), can(robot, "weld(2)")) == (5, 5)


def test_a_type_of_which_only_ground_local_tasks_are_declared() -> None:
    robot = described(cut_1=10)
    assert robot.perform("cut", 4) is None
    assert (can(robot, "cut(1)"), can(robot, "cut(2)"), can(robot, "cut")) == (4, None, None)
    assert robot.perform("cut(2)", 4) == "R has no local task 'cut(2)'; it has cut(1)"


def test_zero_is_a_loss_and_more_ends_it() -> None:
    robot = described(weld=10)
    assert robot.perform("weld", 0) is None
    assert (robot.lost, can(robot, "weld")) == ({"weld": "its performance is 0"}, None)
    assert robot.perform("weld(1)", 5) == "R has lost weld altogether"
    assert robot.perform("weld", 7) is None
    assert (robot.lost, can(robot, "weld")) == ({}, 7)
    assert robot.perform("weld(1)", 0) is None
    assert (can(robot, "weld(1)"), can(robot, "weld(2)")) == (None, 7)
    assert robot.perform("weld(1)", 9) is None
    assert (can(robot, "weld(1)"), can(robot, "weld(2)")) == (9, 7)


def test_what_is_had_again_is_as_good_as_it_was_last() -> None:
    robot = described(weld=10)
    robot.perform("weld", 3)
    robot.lose("all")
    assert robot.restore("all") is None
    assert can(robot, "weld") == 3


@pytest.mark.parametrize(
    ("local_task", "value", "problem"),
    [
        ("fly", 1, "R has no local task 'fly'; it has weld"),
        ("all", 1, "R has no local task 'all'; it has weld"),
        ("weld", -1, "a performance is a number from 0 to 1000000, not -1e-06"),
        ("weld", MAX_PERFORMANCE + 1, "a performance is a number from 0 to 1000000, not 1e+06"),
    ],
)
def test_what_is_no_performance_changes_nothing(local_task: str, value: int, problem: str) -> None:
    robot = described(weld=10)
    assert robot.perform(local_task, value) == problem
    assert robot.changes() == {"lost": {}}


def test_there_is_an_end_to_what_a_robot_can_tell() -> None:
    robot = described(weld=10)
    told = [robot.perform(f"weld({number})", 1) for number in range(MAX_CAPABILITIES)]
    assert told[:-1] == [None] * (MAX_CAPABILITIES - 1)
    assert told[-1] == f"R cannot tell more than {MAX_CAPABILITIES} performances"
    assert robot.perform("weld", 2) is None
    assert can(robot, "weld(5)") == 2


def test_a_reason_is_one_line_and_not_too_long() -> None:
    robot = described(weld=10)
    robot.lose("weld", "torch\n  is " + 300 * "cold ")
    assert robot.lost["weld"].startswith("torch is cold cold")
    assert len(robot.lost["weld"]) == MAX_REASON
    assert member(robot).lost == robot.lost


def test_one_capability_lost_for_two_reasons() -> None:
    robot = described(weld=10, look=10)
    robot.lose("weld", "no gas", PROGRAM)
    robot.lose("all", "the lidar is dead", "background lidar")
    assert robot.lost == {
        "look": "the lidar is dead",
        "weld": "the lidar is dead; no gas",
    }
    # Nobody takes back what somebody else has said, except the operator.
    robot.restore("all", PROGRAM)
    assert robot.lost == dict.fromkeys(("look", "weld"), "the lidar is dead")
    robot.lose("weld", "operator", OPERATOR)
    robot.restore("all", "background lidar")
    assert robot.lost == {"weld": "operator"}
    robot.lose("look", "dark", PROGRAM)
    robot.restore("all", OPERATOR)
    assert robot.lost == {}


def test_what_cannot_be_used_yet_is_not_lost() -> None:
    robot = described(weld=10, look=10)
    robot.lose("weld", "no server yet", PROGRAM, is_pending=True)
    found = member(robot)
    assert (found.lost, found.pending) == ({}, {"weld": "no server yet"})
    assert (capability(found, "weld(1)"), capability(found, "look")) == (None, 10)
    robot.lose("weld", "no server", PROGRAM)
    assert (robot.lost, robot.pending) == ({"weld": "no server"}, {})
    robot.lose("weld", "no gas yet", "gas", is_pending=True)
    assert (robot.lost, robot.pending) == ({"weld": "no server"}, {})
    robot.restore("weld", PROGRAM)
    assert (robot.lost, robot.pending) == ({}, {"weld": "no gas yet"})


def test_a_loss_whose_end_the_program_notices_is_not_ended_by_an_operator() -> None:
    robot = described(weld=10, look=10)
    robot.lose("weld", "the server does not answer", PROGRAM, is_watched=True)
    robot.lose("weld", "operator", OPERATOR)
    robot.lose("look", "dark", PROGRAM)
    assert member(robot).watched == ("weld",)
    robot.restore("all", OPERATOR)
    assert member(robot).lost == {"weld": "the server does not answer"}
    robot.restore("weld", PROGRAM)
    assert (member(robot).lost, member(robot).watched) == ({}, ())


NAMES = ("weld", "weld(1)", "weld(2)", "cut", "cut(1)", "look")


@given(st.lists(st.tuples(st.sampled_from(NAMES), st.integers(0, 5)), max_size=12))
def test_what_was_told_last_of_a_ground_local_task_or_its_type_holds(
    told: list[tuple[str, int]],
) -> None:
    """Held against the words themselves, read from the last to the first."""
    robot = described(weld=10, cut_1=10, look=10)
    words = [(name, value) for name, value in told if robot.perform(name, value) is None]
    for ground, own in (("weld(1)", 10), ("weld(2)", 10), ("cut(1)", 10), ("look", 10)):
        about = (ground, ground.partition("(")[0])
        said = [value for name, value in words if name in about]
        assert (can(robot, ground) or 0) == (said[-1] if said else own)
    assert can(robot, "cut(2)") is None
