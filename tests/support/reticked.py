"""A small reference of a memoryless tree that is ticked again and again, to test the evaluator by.

An action that has ended returns its outcome at each tick that reaches it. One that a tick does not
reach forgets it. One that is running is halted if a tick does not reach it, or if a node above it
has ended.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.tree import Kind, NodeSpec, Status
from tests.support.build import World, action, condition

RUNNING, SUCCESS, FAILURE = Status.RUNNING, Status.SUCCESS, Status.FAILURE
CONDITIONS = ("c0", "c1", "c2")
_INNER = (*(Kind.SEQUENCE, Kind.FALLBACK) * 3, Kind.PARALLEL, Kind.IF_THEN_ELSE)
_DECORATORS = (Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE)


@dataclass
class Reticked:
    """`outcomes` of the actions that have ended, `starts` of all: how often each has been begun."""

    spec: NodeSpec
    conditions: Mapping[str, bool]
    outcomes: dict[str, Status] = field(default_factory=dict)
    starts: dict[str, int] = field(default_factory=dict)
    running: set[str] = field(default_factory=set)

    def tick(self) -> Status:
        """Tick the root; starts and halts actions."""
        reached: set[str] = set()
        status, asked = self._tick(self.spec, reached)
        self.outcomes = {name: each for name, each in self.outcomes.items() if name in reached}
        for name in asked - self.running:
            self.starts[name] = self.starts.get(name, 0) + 1
        self.running = asked
        return status

    def _tick(self, node: NodeSpec, reached: set[str]) -> tuple[Status, set[str]]:
        """Its status, and the actions that run at or below it."""
        match node.kind:
            case Kind.CONDITION:
                return (SUCCESS if self.conditions[node.subject] else FAILURE), set()
            case Kind.ACTION:
                reached.add(node.subject)
                status = self.outcomes.get(node.subject, RUNNING)
                return status, {node.subject} if status is RUNNING else set()
        asked: set[str] = set()
        statuses: list[Status] = []
        for position, child in enumerate(node.children):
            if node.kind is Kind.SEQUENCE and statuses and statuses[-1] is not SUCCESS:
                break
            if node.kind is Kind.FALLBACK and statuses and statuses[-1] is not FAILURE:
                break
            branch = {1: SUCCESS, 2: FAILURE}.get(position)
            if node.kind is Kind.IF_THEN_ELSE and branch and statuses[0] is not branch:
                continue
            status, below = self._tick(child, reached)
            statuses.append(status)
            asked |= below
        status = _status(node, statuses)
        return status, asked if status is RUNNING else set()


def _status(node: NodeSpec, statuses: list[Status]) -> Status:
    last = statuses[-1]
    match node.kind:
        case Kind.PARALLEL if statuses.count(SUCCESS) >= node.limit:
            return SUCCESS
        case Kind.PARALLEL if len(statuses) - statuses.count(FAILURE) < node.limit:
            return FAILURE
        case Kind.PARALLEL:
            return RUNNING
        case Kind.INVERTER if last is not RUNNING:
            return FAILURE if last is SUCCESS else SUCCESS
        case Kind.FORCE_SUCCESS if last is not RUNNING:
            return SUCCESS
        case Kind.FORCE_FAILURE if last is not RUNNING:
            return FAILURE
    return last


def random_tree(source: random.Random, depth: int = 4) -> NodeSpec:
    """Any order of conditions and actions; each action is at one place."""
    count = 0

    def grow(depth: int) -> NodeSpec:
        nonlocal count
        roll = source.random()
        if depth == 0 or roll < 0.15:
            if source.random() < 0.45:
                return condition(source.choice(CONDITIONS))
            count += 1
            return action(f"a{count}")
        if roll < 0.3:
            return NodeSpec(source.choice(_DECORATORS), (grow(depth - 1),))
        kind = source.choice(_INNER)
        size = source.randint(2, 3)
        limit = source.randint(1, size) if kind is Kind.PARALLEL else 0
        return NodeSpec(kind, tuple(grow(depth - 1) for _ in range(size)), limit=limit)

    return grow(depth)


def first_difference(spec: NodeSpec, source: random.Random, steps: int = 30) -> str:
    """Tell one random story to both, one event after the other; empty if they do the same."""
    values = {name: source.random() < 0.5 for name in CONDITIONS}
    world = World(spec, true_at_first=[name for name in CONDITIONS if values[name]])
    reference = Reticked(spec, values)
    began: dict[str, str] = {}
    starts: dict[str, int] = {}
    told: list[str] = []
    for _ in range(steps):
        evaluation = world.tick()
        status = reference.tick()
        asked = {request.subject: request.activation for request in evaluation.requests}
        for name, activation in asked.items():
            if began.get(name) != activation:
                starts[name] = starts.get(name, 0) + 1
        began = asked
        ours = evaluation.status, {name: starts[name] for name in sorted(asked)}
        theirs = status, {name: reference.starts[name] for name in sorted(reference.running)}
        if ours != theirs:
            return f"{'; '.join(told)}: {ours}, and the reference {theirs}"
        known = [name for name in CONDITIONS if world.mission.entries.is_condition(name)]
        if asked and (not known or source.random() < 0.5):
            name, success = source.choice(sorted(asked)), source.random() < 0.7
            told.append(f"{name} {'succeeds' if success else 'fails'}")
            (world.succeed if success else world.fail)(name)
            reference.outcomes[name] = SUCCESS if success else FAILURE
        elif known:
            name = source.choice(known)
            values[name] = not values[name]
            told.append(f"{name} is {values[name]}")
            world.set(name, values[name])
    return ""
