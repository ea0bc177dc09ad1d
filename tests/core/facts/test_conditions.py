"""Entries of the blackboard: which value counts, and how comparisons turn."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.facts.records import ARGUMENTS, CONDITION, EXPRESSION
from mrbt_mesh.core.facts.store import Entry, Incarnation, Version, parse_entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.formats.build import mission_from_yaml
from tests.support.build import RUN, World, refusal
from tests.support.commands import submission

HEAD = """
mission: m
local_tasks: {look: {sets: [found]}, fetch: {parameters: [what]}, charge: {}}
blackboard:
  found: {values: [red, blue]}
  count: {min: 0, max: 9, default: 1}
  battery: {min: 0, max: 100, decimals: 1, per: robot}
robot_types: {T: {capabilities: {look: 1, fetch: 1, charge: 1}}}
robots: {R1: T, R2: T, R3: T}
conditions: {open: {}}
global_tasks:
  look: {needs: {look: {}}}
  get: {parameters: [what], needs: {fetch($what): {}}}
  charge: {needs: {charge: {}}}
"""


def world(tree: str) -> World:
    return World(mission_from_yaml(f"{HEAD}tree: {tree}\n", "m", Path()))


def put(world: World, name: str, value: object, author: str = "R1") -> None:
    changes = world.facts.conditions.changes(name) + 1
    world.write(author, (f"{CONDITION}/{name}", [value, changes, world.facts.max_stamp + 1]))


def test_golden_a_comparison_renews_what_is_behind_it_each_time_it_turns_against_it() -> None:
    w = world("{Sequence: [{Fallback: [{Condition: count >= 3}, look]}, charge]}")
    assert w.activation("look") == f"{RUN}:3:look::0"
    put(w, "count", 5)
    assert [w.activation("charge")] == [f"{RUN}:4:charge::0"]
    put(w, "count", 7)
    assert w.activation("charge") == f"{RUN}:4:charge::0", "another value, the same truth"
    put(w, "count", 2)
    put(w, "count", 3)
    assert w.activation("charge") == f"{RUN}:4:charge::0", "nobody has looked in between"
    put(w, "count", 2)
    assert w.asked() == ["look"]
    put(w, "count", 3)
    assert w.activation("charge") == f"{RUN}:4:charge::1"


def test_an_entry_that_is_not_set_makes_every_comparison_false() -> None:
    w = world("{Sequence: [{Inverter: {Condition: found == red}}, {Condition: found != red}]}")
    assert not w.facts.condition("found == red")
    assert not w.facts.condition("found != red")
    put(w, "found", "blue")
    assert w.facts.condition("found != red")
    put(w, "found", None)
    assert not w.facts.condition("found != red")


def test_a_comparison_of_each_robot_holds_if_it_holds_for_any() -> None:
    w = world("{Sequence: [{Condition: battery < 30}, {Condition: battery@R2 >= 50.5}]}")
    put(w, "battery@R1", 125)
    assert w.facts.condition("battery < 30.0")
    assert w.facts.condition_of("R1", "battery < 30.0")
    assert not w.facts.condition_of("R2", "battery < 30.0")
    assert not w.facts.condition("battery@R2 >= 50.5")
    put(w, "battery@R2", 505)
    assert w.facts.condition("battery@R2 >= 50.5")


def test_an_activation_keeps_the_arguments_with_which_it_has_begun() -> None:
    w = world("{Sequence: [look, get($found)]}")
    w.succeed("look")
    (waiting,) = w.plan().waiting
    assert (waiting.reason, waiting.is_blocked) == ("waiting: found is not set", False)
    put(w, "found", "red")
    (robot,) = w.plan().assignments.values()
    assert robot.values == (("found", "red"),)
    before = w.plan().digest
    put(w, "found", "blue")
    assert w.plan().digest != before, "robots agree on the arguments before they begin"
    activation = w.activation("get($found)")
    w.write("R2", (f"{ARGUMENTS}/{activation}", [["red"], 9]))
    w.write("R1", (f"{ARGUMENTS}/{activation}", [["blue"], 9]))
    (robot,) = w.plan().assignments.values()
    assert robot.values == (("found", "blue"),), "of two that began at once R1 counts"


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("condition/found", ["red", 1, 1], None),
        ("condition/found", [None, 1, 1], None),
        ("condition/found", ["green", 1, 1], "one of red, blue"),
        ("condition/found", [True, 1, 1], "one of red, blue"),
        ("condition/count", [10, 1, 1], "from 0 to 9"),
        ("condition/open", [1, 1, 1], "true or false"),
        ("condition/battery", [1, 1, 1], "not of this robot"),
        ("condition/battery@R9", [1, 1, 1], "not of this robot"),
        ("expression/count >= 3", [1, [[1, 1, "R1"]]], None),
        ("expression/count >= 3", [1, [1]], "does not follow"),
        ("expression/count >= 4", [1, [[1, 1, "R1"]]], "not a guard"),
        (f"arguments/{RUN}:3:charge::0", [["red"], 1], "reads no entries"),
    ],
)
def test_what_robots_may_say(name: str, value: object, reason: str | None) -> None:
    w = world("{Sequence: [{Condition: count >= 3}, {Condition: open}, charge]}")
    entry = parse_entry("R1", name, Version(Incarnation(1, "n"), 9), value)
    found = refusal(w.facts, entry)
    assert found is None if reason is None else reason in str(found)


# -- replicas ---------------------------------------------------------------------------------

TREE = """
  Sequence:
    - Fallback: [{Condition: found == red}, {Condition: open}, look]
    - Fallback: [{Condition: battery < 30}, get(3)]
    - charge
"""
SAID = st.lists(
    st.tuples(
        st.sampled_from(["R1", "R2", "R3"]),
        st.sampled_from([("found", "red"), ("found", "blue"), ("found", None)])
        | st.tuples(st.sampled_from(["battery@R1", "battery@R3"]), st.integers(0, 600)),
    ),
    min_size=1,
    max_size=12,
)


class Replica:
    """What one robot knows, and what it writes down of it, as agents do."""

    def __init__(self, robot: str, facts: TeamFacts) -> None:
        self.robot, self.facts, self.written = robot, facts, 0

    def write(self, name: str, value: object) -> Entry:
        self.written += 1
        version = Version(Incarnation(1, "n"), self.written)
        entry = parse_entry(self.robot, name, version, value)
        assert refusal(self.facts, entry) is None
        self.facts.map.merge([entry])
        return entry

    def put(self, name: str, value: object) -> Entry:
        changes = self.facts.conditions.changes(name) + 1
        return self.write(f"{CONDITION}/{name}", [value, changes, self.facts.max_stamp + 1])

    def note(self) -> list[Entry]:
        found = []
        while turned := self.facts.turned_guards():
            found += [self.write(f"{EXPRESSION}/{name}", r.to_value()) for name, r in turned]
        return found


@given(SAID, st.integers(0, 1_000))
def test_replicas_come_to_one_plan_however_late_they_hear_of_values(
    said: list[tuple[str, tuple[str, object]]], seed: int
) -> None:
    """In any order of messages; and nobody answers late news with another turn without end."""
    mission, chance = world(TREE).mission, random.Random(seed)
    replicas = {robot: Replica(robot, TeamFacts(mission, RUN)) for robot in mission.robots}
    on_the_way: list[tuple[str, Entry]] = []
    steps = list(said)
    for _ in range(2_000):
        if steps and chance.random() < 0.5:
            robot, change = steps.pop(0)
            fresh = [replicas[robot].put(*change)]
        else:
            if not on_the_way:
                continue
            robot, entry = on_the_way.pop(chance.randrange(len(on_the_way)))
            replicas[robot].facts.map.merge([entry])
            fresh = []
        fresh += replicas[robot].note()
        on_the_way += [(other, entry) for entry in fresh for other in replicas if other != robot]
    assert not on_the_way, "notes answer one another for ever"
    one, *others = (replica.facts for replica in replicas.values())
    names = ("found == red", "battery < 30.0")
    for facts in others:
        assert [facts.condition(n) for n in names] == [one.condition(n) for n in names]
        assert {str(e) for e in facts.map} == {str(e) for e in one.map}
        found, wanted = (mission.evaluator.evaluate(each) for each in (facts, one))
        assert found.requests == wanted.requests
    assert all(parse_activation(r.activation).turns <= len(said) for r in wanted.requests)


def test_who_knows_less_of_two_values_of_one_revision_waits() -> None:
    """R1 and R2 have set the entry at the same time, and R3 has not heard of the value that counts.

    Otherwise it would answer the turn that R1 has seen with another one.
    """
    mission = world("{Sequence: [{Condition: found == red}, charge]}").mission
    first, second, third = (Replica(r, TeamFacts(mission, RUN)) for r in ("R1", "R2", "R3"))
    red, blue = first.put("found", "red"), second.put("found", "blue")
    notes = first.note()
    first.facts.map.merge([blue])
    notes += first.note()
    assert len(notes) == 2
    third.facts.map.merge([red, *notes])
    assert third.note() == []
    third.facts.map.merge([blue])
    assert third.note() == []
    assert third.facts.conditions.changes("found == red") == 2


def test_comparisons_with_the_parameters_of_jobs_wait_for_a_job() -> None:
    """Facts may come before any job is in the tree."""
    text = f"""{HEAD}
ends: never
jobs:
  bring:
    parameters: {{most: {{min: 1, max: 9}}}}
    tree:
      Sequence:
        - Fallback: [look, {{Condition: count < $most}}, {{Condition: battery < $most}}]
        - charge
tree: {{Jobs: all}}
"""
    mission = mission_from_yaml(text, "m", Path())
    first = Replica("R1", TeamFacts(mission, RUN))
    first.put("count", 7)
    first.put("battery@R1", 600)
    assert not first.facts.condition("count < {most}")
    first.facts.map.merge([submission("j1", "bring", "6")])
    assert first.facts.mission.tree.nodes[0].children
    assert not first.facts.condition("count < 6")
    first.put("battery@R2", 15)
    notes = first.note()
    assert {"expression/count < 6", "expression/battery < 6"} <= {each.name for each in notes}
    late = TeamFacts(mission, RUN)  # which does not know of the job
    assert [refusal(late, each) for each in notes if "#" not in each.name] == [None] * 3
