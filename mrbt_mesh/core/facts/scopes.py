"""What has changed of a team's facts, for those that bring something up to date with them."""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from dataclasses import dataclass, field
from typing import Protocol

from mrbt_mesh.core.bt.activation import Activation, ActivationNames, parse_activation
from mrbt_mesh.core.bt.evaluation import EvaluationFacts

# Author and name of an entry.
Key = tuple[str, str]


@dataclass(slots=True)
class FactChanges:
    """What may make an evaluation differ, since whoever follows it has cleared it.

    Conditions by name; nodes of whose activations or scopes something was said, or may be read
    otherwise; (node, position) where a node with memory was told of a child. The values are
    None: in the order in which it happened, each once.
    """

    conditions: dict[str, None] = field(default_factory=dict)
    nodes: dict[int, None] = field(default_factory=dict)
    child_results: dict[tuple[int, int], None] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return bool(self.conditions or self.nodes or self.child_results)

    def clear(self) -> None:
        """Begin anew."""
        for each in (self.conditions, self.nodes, self.child_results):
            each.clear()


class TurningFacts(EvaluationFacts, Protocol):
    """Facts that know how often a condition would have turned at an earlier revision."""

    def turns_at(self, name: str, value: bool, revision: int) -> int: ...


@dataclass(slots=True)
class _Scope:
    name: Activation
    keys: dict[Key, None] = field(default_factory=dict)


class ScopedEntries:
    """The entries that belong to an activation or another scope, by scope and by node.

    It knows which of them may have come out of reach since `take_obsolete`: those that are new,
    and those at nodes whose guards have turned, or that are in a loop that goes round.
    """

    def __init__(self) -> None:
        self.by_scope: dict[str, _Scope] = {}
        self._at: dict[int, dict[str, None]] = {}
        self._nodes: list[int] = []
        self._fresh: dict[str, None] = {}
        self._revisions: dict[str, int] = {}
        self._loops: dict[int, None] = {}

    def add(self, scope: str, key: Key) -> int:
        """Take in an entry; returns the node."""
        known = self.by_scope.get(scope)
        if known is None:
            known = self.by_scope[scope] = _Scope(parse_activation(scope))
            node = known.name.node
            if node not in self._at:
                self._at[node] = {}
                insort(self._nodes, node)
            self._at[node][scope] = None
        known.keys[key] = None
        self._fresh[scope] = None
        return known.name.node

    def remove(self, scope: str, key: Key) -> int:
        """Leave out an entry; returns the node."""
        known = self.by_scope[scope]
        node = known.name.node
        del known.keys[key]
        if not known.keys:
            del self.by_scope[scope]
            del self._at[node][scope]
            if not self._at[node]:
                del self._at[node]
                del self._nodes[bisect_left(self._nodes, node)]
        return node

    def condition_changes(self, name: str, revision: int) -> None:
        """A condition that had this revision gets another one."""
        self._revisions.setdefault(name, revision)

    def goes_round(self, loop: int) -> None:
        """The attempt number of a Retry or Repeat has changed."""
        self._loops[loop] = None

    def take_obsolete(self, names: ActivationNames, facts: TurningFacts) -> list[Key]:
        """The entries that no evaluation can reach any more, sorted; they are to be removed."""
        if not (self._fresh or self._revisions or self._loops):
            return []
        looked_at = self._fresh
        turned = [
            (name, value)
            for name, before in self._revisions.items()
            for value in (True, False)
            if facts.turns_at(name, value, before) != facts.turns(name, value)
        ]
        for first, last in names.renamed(turned, self._loops):
            begin = bisect_left(self._nodes, first)
            for node in self._nodes[begin : bisect_right(self._nodes, last, begin)]:
                looked_at.update(self._at[node])
        scopes = [self.by_scope[scope] for scope in looked_at if scope in self.by_scope]
        obsolete = [scope for scope in scopes if names.is_obsolete(scope.name, facts)]
        self._forget_changes()
        return sorted(key for scope in obsolete for key in scope.keys)

    def _forget_changes(self) -> None:
        for changed in (self._fresh, self._revisions, self._loops):
            changed.clear()
