"""Random trees of a single robot, whose actions declare what they do."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec
from mrbt_mesh.formats.declaration import Declaration
from tests.support.build import action, condition

VARIABLES = ("v0", "v1", "v2", "v3", "v4", "v5")
REST = ("x0", "x1", "x2")  # what actions read and write besides conditions


@dataclass
class Grower:
    """A random tree of actions that declare what they do."""

    random: random.Random
    declared: dict[str, Declaration] = field(default_factory=dict)

    def tree(self, depth: int = 3) -> NodeSpec:
        roll = self.random.random()
        if depth == 0 or roll < 0.15:
            return self._leaf()
        if roll < 0.25:
            kind = self.random.choice(
                (Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.RETRY, Kind.SUBTREE, Kind.REPEAT)
            )
            limit = 2 if kind in (Kind.RETRY, Kind.REPEAT) else 0
            return NodeSpec(kind, (self.tree(depth - 1),), limit=limit)
        if roll < 0.32:
            children = tuple(self.tree(depth - 1) for _ in range(self.random.randint(2, 3)))
            return NodeSpec(Kind.IF_THEN_ELSE, children, memory=self._memory())
        kind = Kind.SEQUENCE if self.random.random() < 0.65 else Kind.FALLBACK
        children = tuple(self.tree(depth - 1) for _ in range(self.random.randint(2, 4)))
        return NodeSpec(kind, children, memory=self._memory())

    def _memory(self) -> Memory:
        return self.random.choice((Memory.NONE, Memory.WHILE_RUNNING))

    def _some(self, names: tuple[str, ...], most: int) -> list[str]:
        return self.random.sample(names, self.random.choice([0, 0, *range(most + 1)]))

    def _leaf(self) -> NodeSpec:
        if self.random.random() < 0.2:
            return condition(self.random.choice(VARIABLES))
        name = f"a{len(self.declared)}"
        self.declared[name] = Declaration(
            reads=frozenset(self._some(REST, 1)),
            writes=frozenset(self._some(REST, 1)),
            uses=frozenset(self._some(("arm",), 1)) if self.random.random() < 0.2 else frozenset(),
            requires={v: self.random.random() < 0.7 for v in self._some(VARIABLES, 1)},
            effects={v: self.random.random() < 0.7 for v in self._some(VARIABLES, 2)},
            may_fail=self.random.random() < 0.15,
        )
        return action(name)
