"""Which nodes of a revision are the same as before."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.mission.compiled import compile_mission, mission_from_compiled
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.features.revisions.revise import RevisionError, revise
from mrbt_mesh.features.revisions.section import revision_of, without_revision
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.sim.chaos.generate import generate_mission
from mrbt_mesh.sim.chaos.vary import varied

FILE = """
mission: line
local_tasks: {weld: {parameters: [part]}, look: {parameters: [part]}}
robot_types: {arm: {capabilities: {weld: 1, look: 1}}}
robots: {A1: arm, A2: arm}
conditions: {open: {default: %s}, lit: {}}
global_tasks:
  join: {parameters: [part], needs: {weld($part): {min: %s}}}
  check: {parameters: [part], needs: {look($part): {min: 1}}}
tree: %s
"""


def mission(tree: str, default: str = "false", robots: int = 1) -> Mission:
    return mission_from_yaml(FILE % (default, robots, tree), "line.yaml", Path())


def numbers(found: Mission) -> dict[str, list[int]]:
    """Global task -> the numbers of its leaves."""
    leaves: dict[str, list[int]] = {}
    for node in found.tree.actions():
        leaves.setdefault(node.subject, []).append(node.number)
    return leaves


TWICE = "{RetryUntilSuccessful: {attempts: 2, do: join(2)}}"
BEFORE = mission(f"{{Sequence: [join(1), check(1), {TWICE}]}}")
OLD = numbers(BEFORE)


@pytest.mark.parametrize(
    ("tree", "kept"),
    [
        ("{Sequence: [check(1), join(1)]}", {"join(1)", "check(1)"}),
        ("{Parallel: {success: all, children: [join(3), join(1)]}}", {"join(1)"}),
        ("{ForceSuccess: {Fallback: [join(1), check(1)]}}", {"join(1)", "check(1)"}),
        ("{Sequence: [{Condition: open}, join(1)]}", set()),
        ("{RetryUntilSuccessful: {attempts: 2, do: join(1)}}", set()),
        (
            f"{{Sequence: [{TWICE}, join(1)]}}",
            {"join(1)", "join(2)"},
        ),
        ("{RetryUntilSuccessful: {attempts: 3, do: join(2)}}", {"join(2)"}),
        ("{RetryUntilSuccessful: {attempts: 2, do: {Inverter: join(2)}}}", set()),
        ("join(2)", set()),
    ],
)
def test_an_action_is_the_same_wherever_it_is(tree: str, kept: set[str]) -> None:
    """Unless what guards it, or a node that remembers around it, is another one."""
    found = numbers(revise(BEFORE, mission(tree)))
    assert {name for name, those in found.items() if those == OLD.get(name)} == kept
    used = set(range(len(BEFORE.tree.nodes)))
    assert all(not used & set(those) for name, those in found.items() if name not in kept)


def test_a_task_with_other_needs_is_another_one() -> None:
    after = mission("{Sequence: [join(1), check(1)]}", robots=2)
    found = numbers(revise(BEFORE, after))
    assert found["check(1)"] == OLD["check(1)"]
    assert found["join(1)"] != OLD["join(1)"]


def test_of_several_places_of_a_task_the_order_decides() -> None:
    twice = mission("{Sequence: [join(1), check(1), join(1)]}")
    first, second = numbers(twice)["join(1)"]
    assert numbers(revise(twice, mission("join(1)")))["join(1)"] == [first]
    thrice = numbers(revise(twice, mission("{Sequence: [join(1), join(1), join(1)]}")))["join(1)"]
    assert thrice[:2] == [first, second]


def test_a_condition_keeps_its_declaration() -> None:
    with pytest.raises(RevisionError, match="condition open is declared otherwise"):
        revise(BEFORE, mission("join(1)", default="true"))


ENTRIES = """
mission: m
local_tasks: {w: {work: 1}}
blackboard: {n: {min: 0, max: %d, default: 0}}
robot_types: {r: {capabilities: {w: 1}}}
robots: {A1: r}
global_tasks: {t: {needs: {w: {}}}}
tree: {Sequence: [{Condition: "n < 5"}, t]}
"""


def test_an_entry_of_the_blackboard_keeps_its_declaration() -> None:
    before, after = (mission_from_yaml(ENTRIES % most, "m.yaml", Path()) for most in (20, 5))
    with pytest.raises(RevisionError, match="entry n of the blackboard is declared otherwise"):
        revise(before, after)


def test_back_and_forth() -> None:
    """The numbers of the first mission come back, those that were used between are for others."""
    other = revise(BEFORE, mission("{Sequence: [check(3), join(1)]}"))
    back = revise(other, BEFORE)
    assert numbers(back) == OLD
    assert (back.number, back.team_digest) == (2, BEFORE.digest)
    forth = revise(back, mission("{Sequence: [check(3), join(1)]}"))
    assert numbers(forth) == numbers(other)


@given(st.integers(0, 200), st.integers(0, 2**32))
def test_any_revision_can_be_sent_and_read(seed: int, number: int) -> None:
    """Of any mission: itself is the same in all nodes, a variation has no number twice."""
    before = generate_mission(seed).mission
    same = revise(before, before)
    assert [node.number for node in same.tree.nodes] == [node.index for node in before.tree.nodes]
    after = revise(same, varied(before, random.Random(number)))
    read = mission_from_compiled(compile_mission(after), "it")
    assert (read, read.digest) == (after, after.digest)
    found = [node.number for node in after.tree.nodes]
    assert len(set(found)) == len(found)
    revision = revision_of(after)
    assert revision is not None
    assert max(found) < revision.next_node
    assert without_revision(after).tree == after.tree
    old = {node.number: node for node in same.tree.nodes}
    for node in after.tree.nodes:
        if node.number in old and node.kind is Kind.ACTION:
            assert old[node.number].subject == node.subject
            guards = before.evaluator.guards_of[old[node.number].index]
            assert sorted(guards) == sorted(after.evaluator.guards_of[node.index])
