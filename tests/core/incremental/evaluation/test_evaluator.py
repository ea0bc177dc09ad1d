"""Evaluating again gives what evaluating from scratch gives, whatever has changed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrbt_mesh.core.bt.activation import parse_activation
from mrbt_mesh.core.bt.evaluation import Evaluation
from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, CONTROLS, Kind, Memory, NodeSpec, Status
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import CoalitionId
from mrbt_mesh.core.incremental.evaluation.compiled_evaluator import CompiledEvaluator
from mrbt_mesh.core.incremental.evaluation.evaluator import IncrementalEvaluator
from mrbt_mesh.core.mission.mission import FailurePolicy, GlobalTask, InDoubtPolicy
from tests.support.build import (
    World,
    action,
    condition,
    fallback,
    leaves,
    make_mission,
    parallel,
    retry,
    sequence,
    task,
    timeout,
)
from tests.support.effort import seeds
from tests.support.strategies import UNARY, tree_specs

ROBOTS = ("R1", "R2", "R3")
STORIES, PER_STORY = 6, 50


# -- random facts -----------------------------------------------------------------------------


class Facts:
    """Facts as they may come over the network, also such as no robot would write."""

    def __init__(self, spec: NodeSpec, source: Random) -> None:
        self.source = source
        names = leaves(spec, Kind.ACTION)
        tasks = [self._task(name) for name in names]
        robots = {robot: dict.fromkeys((*names, "also"), 1.0) for robot in ROBOTS}
        self.world = World(make_mission(spec, robots, tasks))
        tree = self.world.mission.tree
        self.nodes = [n for n in tree.nodes if n.kind is not Kind.CONDITION]
        self.seen: list[str] = []
        self.statuses = bytes(len(tree.nodes))

    def _task(self, name: str) -> GlobalTask:
        bounds = ((name, self.number(1, 2), 3), ("also", 1, 2))
        failure = self.source.choice(tuple(FailurePolicy))
        count = self.number(1, 2)
        match self.number(0, 5):
            case 0:
                return task(name, *bounds[:count], failure=failure, simultaneous=True)
            case 1:
                doubt = self.source.choice(tuple(InDoubtPolicy))
                return task(name, *bounds[:count], failure=failure, exclusive=True, in_doubt=doubt)
        return task(name, *bounds[:count], failure=failure)

    def number(self, low: int, high: int) -> int:
        return self.source.randint(low, high)

    def happen(self) -> None:
        """Something of any kind becomes known."""
        world = self.world
        robot = self.source.choice(ROBOTS)
        ticked = [each for each in self.nodes if self.statuses[each.index]]
        nodes = ticked if ticked and self.number(0, 4) else self.nodes
        node = self.source.choice(nodes) if nodes else None
        what = self.number(0, 12)
        conditions = sorted(world.mission.conditions)
        if what <= 3 and conditions:
            self._set(self.source.choice(conditions), robot)
        elif what == 4:
            self._describe(robot)
        elif what == 5:
            world.facts.prune(world.evaluator)
        elif what == 6:
            self._write_down(world.evaluator.evaluate(world.facts))
        elif node is not None and node.kind is Kind.ACTION:
            self._act(node.subject, self._scope(node.index), robot)
        elif node is not None and node.kind in ATTEMPT_KINDS:
            world.write(robot, (f"{records.ATTEMPT}/{self._scope(node.index)}", self.number(0, 4)))
        elif node is not None and node.kind is Kind.TIMEOUT:
            world.write(robot, (f"{records.EXPIRED}/{self._scope(node.index)}", True))
        elif node is not None and node.kind in CONTROLS and node.memory is not Memory.NONE:
            position = self.number(0, len(node.children) - 1)
            name = f"{records.CHILD_RESULT}/{self._scope(node.index)}/{position}"
            world.write(robot, (name, bool(self.number(0, 2))))

    def _scope(self, node: int) -> str:
        """Mostly the name of now, else one that was or may come."""
        name = self.world.evaluator.current_activation(node, self.world.facts)
        if self.number(0, 3) == 0:
            attempts = tuple(max(0, n + self.number(-1, 1)) for n in name.attempts)
            name = replace(name, attempts=attempts, turns=max(0, name.turns + self.number(-1, 1)))
        known = [text for text in self.seen if parse_activation(text).node == node]
        text = str(name) if not known or self.number(0, 3) else known[-1]
        self.seen.append(text)
        return text

    def _set(self, name: str, robot: str) -> None:
        facts = self.world.facts
        revision = facts.conditions.revision(name) + self.number(1, 3)
        value = facts.mission.condition_default(name) ^ bool(revision % 2)
        row = [value, revision, facts.max_stamp + 1]
        self.world.write(robot, (f"{records.CONDITION}/{name}", row))

    def _describe(self, robot: str) -> None:
        names = sorted(
            {n.local_task for t in self.world.mission.global_tasks.values() for n in t.needs}
        )
        able = {name: 1_000_000 for name in names if self.number(0, 2)}
        life = self.world.alive[robot].counter + self.number(0, 1)
        self.world.join(robot, able, life=life)

    def _act(self, subject: str, activation: str, robot: str) -> None:
        world, needed = self.world, self.world.mission.global_tasks[subject]
        local = self.source.choice(needed.needs).local_task
        success = bool(self.number(0, 2))
        what = self.number(0, 4)
        if what == 0:
            world.write(robot, (f"{records.VERDICT}/{activation}", True))
        elif what == 1:
            world.claim(robot, activation, local)
        elif not needed.by_coalition:
            world.outcome(activation, success, robot, local)
        elif what == 2:
            world.form(activation, *ROBOTS[: self.number(1, 3)], local=local)
        else:
            token = CoalitionId(1, ROBOTS[0], *world.alive[ROBOTS[0]])
            kinds = (records.BROKEN, records.GRANT, records.DOUBT, records.DONE, records.CLEARED)
            kind = kinds[self.number(0, len(kinds) - 1 if needed.exclusive else 0)]
            if self.number(0, 1):
                world.end(activation, token, robot, success, local)
            elif kind == records.DONE:
                world.write(robot, (f"{records.DONE}/{activation}", True))
            else:
                world.say(kind, activation, token, robot)

    def _write_down(self, evaluation: Evaluation) -> None:
        """Some of what follows from an evaluation."""
        rows = [(f"{records.ATTEMPT}/{scope}", number) for scope, number in evaluation.attempts]
        rows += [(f"{records.VERDICT}/{name}", True) for name in evaluation.failures]
        rows += [
            (f"{records.CHILD_RESULT}/{scope}/{position}", success)
            for scope, position, success in evaluation.child_results
        ]
        rows = [row for row in rows if self.number(0, 4)]
        if rows:
            self.world.write("R1", *rows)


def grow(source: Random, depth: int) -> NodeSpec:
    """A random tree of all kinds; its conditions repeat."""
    roll = source.random()
    if depth == 0 or roll < 0.1:
        if source.random() < 0.6:
            return action(f"a{source.randint(0, 1_000_000)}")
        return condition(source.choice(("c0", "c1", "c2", "c3")))
    if roll < 0.35:
        kind = source.choice((*UNARY, *3 * (Kind.RETRY,), Kind.REPEAT))
        limit = source.choice((-1, 1, 2, 3)) if kind in (Kind.RETRY, Kind.REPEAT) else 0
        child = grow(source, depth - 1)
        return NodeSpec(kind, (child,), limit=limit, timeout_us=(kind is Kind.TIMEOUT) * 5)
    kind = source.choice(sorted(CONTROLS))
    count = source.randint(2, 3) if kind is Kind.IF_THEN_ELSE else source.randint(1, 4)
    children = tuple(grow(source, depth - 1) for _ in range(count))
    limit = source.randint(1, count) if kind is Kind.PARALLEL else 0
    failures = source.randint(0, count) if kind is Kind.PARALLEL else 0
    memory = source.choice((Memory.NONE, *Memory))
    if memory is Memory.UNTIL_SUCCESS and kind is not Kind.SEQUENCE:
        memory = Memory.WHILE_RUNNING
    return NodeSpec(kind, children, limit=limit, failures=failures, memory=memory)


def tell(spec: NodeSpec, source: Random, steps: int) -> Iterator[tuple[Facts, Evaluation]]:
    """A story, evaluated step by step; each step is held against both definitions."""
    story = Facts(spec, source)
    world = story.world
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    plain = Evaluator(world.mission.tree)
    if source.random() < 0.3:
        world.evaluator = again  # then it prunes as well
    scratch = CompiledEvaluator(world.mission.tree)
    for _ in range(steps):
        for _ in range(source.choice((1, 1, 1, 2, 5))):
            story.happen()
        found = again.evaluate(world.facts)
        assert found == scratch.evaluate(world.facts)
        assert found == plain.evaluate(world.facts)
        assert again.evaluate(world.facts) is found
        for node in range(len(world.mission.tree.nodes)):
            scope = scratch.current_activation(node, world.facts)
            assert again.current_activation(node, world.facts) == scope
        story.statuses = found.statuses
        yield story, found


@given(tree_specs(max_leaves=14), st.randoms(use_true_random=False))
def test_whatever_becomes_known_it_is_as_from_scratch(spec: NodeSpec, source: Random) -> None:
    for _ in tell(spec, source, 12):
        pass


@pytest.mark.parametrize("story", seeds(STORIES))
def test_long_stories_are_as_from_scratch_at_every_step(story: int) -> None:
    for seed in range(story * PER_STORY, (story + 1) * PER_STORY):
        source = Random(f"story/{seed}")
        try:
            for _ in tell(grow(source, 5), source, 50):
                pass
        except AssertionError as error:
            raise AssertionError(f"seed {seed}") from error


@given(tree_specs(max_leaves=14), st.randoms(use_true_random=False))
def test_pruning_drops_all_that_is_out_of_reach_and_nothing_else(
    spec: NodeSpec, source: Random
) -> None:
    story = Facts(spec, source)
    world = story.world
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    for _ in range(12):
        for _ in range(source.randint(1, 3)):
            story.happen()
        before = {(entry.author, entry.name) for entry in world.facts.map}
        dropped = world.facts.prune(again)
        assert dropped == sorted(before - {(e.author, e.name) for e in world.facts.map})
        for author, name in before:
            kind, *names = records.split_name(name)
            if kind not in (records.MEMBER, records.CLAIM, records.CONDITION):
                scope = parse_activation(names[0])
                is_obsolete = world.evaluator.is_obsolete(scope, world.facts)
                assert is_obsolete == ((author, name) in dropped), name
        again.evaluate(world.facts)


# -- single cases -----------------------------------------------------------------------------


class Reads:
    """Counts what evaluations read of a team's facts."""

    def __init__(self, world: World, monkeypatch: pytest.MonkeyPatch) -> None:
        self.count = 0
        for name in ("condition", "task_status", "attempts_used", "has_expired", "child_result"):
            monkeypatch.setattr(world.facts, name, self._counted(getattr(world.facts, name)))

    def _counted(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            self.count += 1
            return function(*arguments)

        return call


MANY = 2_000
ACTIONS = tuple(action(f"a{number}") for number in range(MANY))
CHECKED = tuple(
    fallback(condition(f"c{number}"), action(f"a{number}")) for number in range(MANY // 2)
)


@pytest.mark.parametrize(
    ("spec", "reads"),
    [
        (parallel(MANY, *ACTIONS), 1),
        (sequence(*ACTIONS), 2),
        (parallel(len(CHECKED), *CHECKED), 1),
        (sequence(*CHECKED), 3),
        (retry(3, parallel(MANY, *ACTIONS)), 2),
        (parallel(MANY // 2, *(timeout(1, each) for each in ACTIONS[: MANY // 2])), 1),
        (sequence(condition("on"), parallel(MANY, *ACTIONS)), 1),
    ],
)
def test_an_outcome_among_thousands_of_nodes_leads_to_few_reads(
    spec: NodeSpec, reads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots = {"R1": {"a0": 1.0}}
    world = World(make_mission(spec, robots, true_at_first=("on",)))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    found = again.evaluate(world.facts)
    counted = Reads(world, monkeypatch)
    for _ in range(3):
        world.outcome(found.requests[len(found.requests) // 2].activation, True)
        counted.count = 0
        found = again.evaluate(world.facts)
        assert counted.count <= reads
        assert found == Evaluator(world.mission.tree).evaluate(world.facts)


def test_what_the_tree_does_not_read_changes_nothing() -> None:
    world = World(sequence(condition("c"), action("a")), true_at_first=("c",))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    before = again.evaluate(world.facts)
    world.claim("R1", world.activation("a"))
    world.order("pause", 1)
    assert again.evaluate(world.facts) is before


def test_a_guard_that_turns_renews_only_what_it_guards() -> None:
    guarded = sequence(condition("c"), action("a"))
    world = World(parallel(2, guarded, action("b")), true_at_first=("c",))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    _, kept = again.evaluate(world.facts).requests
    world.set("c", False)
    world.set("c", True)
    renewed, same = again.evaluate(world.facts).requests
    assert parse_activation(renewed.activation).turns == 1
    assert same is kept


def test_facts_of_another_team_are_evaluated_from_scratch() -> None:
    spec = parallel(2, action("a"), action("b"))
    world, other = World(spec), World(spec)
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    again.evaluate(world.facts)
    other.succeed("a")
    assert [r.subject for r in again.evaluate(other.facts).requests] == ["b"]
    assert [r.subject for r in again.evaluate(world.facts).requests] == ["a", "b"]


def test_after_facts_that_could_not_be_read_it_starts_from_scratch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(parallel(2, action("a"), action("b")))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    first, second = again.evaluate(world.facts).requests
    world.outcome(first.activation, True)
    with monkeypatch.context() as patch:
        patch.setattr(world.facts, "task_status", lambda *_: 1 // 0)
        with pytest.raises(ZeroDivisionError):
            again.evaluate(world.facts)
    world.outcome(second.activation, True)
    assert again.evaluate(world.facts).status is Status.SUCCESS


def test_who_joins_or_learns_matters_where_somebody_has_failed() -> None:
    spec = action("a")
    world = World(make_mission(spec, {"R1": {"a": 1}, "R2": {"b": 1}}))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    world.outcome(again.evaluate(world.facts).requests[0].activation, False)
    assert again.evaluate(world.facts).status is Status.FAILURE
    world.join("R2", {"a": 1_000_000})
    assert again.evaluate(world.facts).status is Status.RUNNING
    world.outcome(again.evaluate(world.facts).requests[0].activation, False, "R2")
    assert again.evaluate(world.facts).status is Status.FAILURE


def test_by_the_papers_policy_a_claim_counts() -> None:
    paper = task("a", ("a", 1, 2), failure=FailurePolicy.PAPER)
    world = World(make_mission(action("a"), {"R1": {"a": 1}, "R2": {"a": 1}}, [paper]))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    activation = again.evaluate(world.facts).requests[0].activation
    world.outcome(activation, False)
    assert again.evaluate(world.facts).status is Status.FAILURE
    world.claim("R2", activation)
    assert again.evaluate(world.facts).status is Status.RUNNING
    world.join("R2", world.facts.members["R2"].member.capabilities, life=2)
    assert again.evaluate(world.facts).status is Status.FAILURE, "a claim of another life"


def test_a_straggler_of_an_attempt_that_nobody_has_written_down_as_used_up() -> None:
    world = World(retry(3, action("a")))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    (first,) = again.evaluate(world.facts).requests
    world.outcome(first.activation, False)
    assert again.evaluate(world.facts).attempts
    world.outcome(first.activation, True, "R2")
    found = again.evaluate(world.facts)
    assert (found.status, found.attempts) == (Status.SUCCESS, ())


def test_two_conditions_that_change_places_at_once_change_nothing() -> None:
    guard = fallback(condition("c0"), condition("c1"))
    world = World(sequence(guard, action("a")), true_at_first=("c1",))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    (asked,) = again.evaluate(world.facts).requests
    world.set("c0", True)
    world.set("c1", False)
    found = again.evaluate(world.facts)
    assert found == world.evaluator.evaluate(world.facts)
    assert found.requests[0].node == asked.node


def test_what_an_inner_loop_has_used_up_is_said_once() -> None:
    world = World(retry(3, retry(2, action("a"))))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    again.evaluate(world.facts)
    for attempts in ("0.0", "0.1"):
        world.outcome(f"r1:2:a:{attempts}:0", False)
    found = again.evaluate(world.facts)
    assert [number for _, number in found.attempts] == [1, 1]
    world.write("R1", *((f"{records.ATTEMPT}/{scope}", n) for scope, n in found.attempts))
    assert again.evaluate(world.facts).attempts == ()


def test_a_guard_that_turns_takes_back_what_actions_behind_it_have_decided() -> None:
    spec = retry(2, sequence(condition("c"), action("a"), action("b")))
    world = World(spec, true_at_first=("c",))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    world.outcome(again.evaluate(world.facts).requests[0].activation, True)
    again.evaluate(world.facts)
    world.set("c", False)
    found = again.evaluate(world.facts)
    assert (found.status, found.attempts) == (Status.FAILURE, ()), "conditions use up no attempt"


def test_of_two_guards_that_turn_at_once_the_left_one_renews_more() -> None:
    spec = sequence(condition("c0"), action("a"), condition("c1"), action("b"))
    world = World(spec, true_at_first=("c0", "c1"))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    world.outcome(again.evaluate(world.facts).requests[0].activation, True)
    assert [r.subject for r in again.evaluate(world.facts).requests] == ["b"]
    for name in ("c0", "c1"):
        world.set(name, False)
        world.set(name, True)
    assert [r.subject for r in again.evaluate(world.facts).requests] == ["a"]


def test_a_timeout_that_expires_uses_up_an_attempt() -> None:
    world = World(retry(2, timeout(1, action("a"))))
    again = IncrementalEvaluator(world.mission.tree, world.facts)
    (running,) = again.evaluate(world.facts).timeouts
    world.write("R1", (f"{records.EXPIRED}/{running.activation}", True))
    assert [number for _, number in again.evaluate(world.facts).attempts] == [1]
