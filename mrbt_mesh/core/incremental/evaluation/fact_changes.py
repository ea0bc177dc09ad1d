"""What has changed of a team's facts since an evaluator last looked.

It listens to the map of facts, so that the facts themselves need not know who follows them.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Iterable, Sequence

from mrbt_mesh.core.bt.activation import Activation, parse_activation
from mrbt_mesh.core.bt.guards import Guard
from mrbt_mesh.core.facts import records
from mrbt_mesh.core.facts.records import Claim, Member, Outcome
from mrbt_mesh.core.facts.store import Change, Entry
from mrbt_mesh.core.facts.team_facts import TeamFacts
from mrbt_mesh.core.facts.validation import ACTIVATION_KINDS
from mrbt_mesh.core.mission.conditions import split_owner


class FactChanges:
    """What may make an evaluation differ, since it was cleared last.

    `conditions` by the names that leaves read, expressions by id; `nodes` of whose activations
    something was said, or may be read otherwise; `child_results`: (node, position) where a node
    with memory was told of a child. The values are None: in the order in which it happened, each
    once.
    """

    def __init__(self, facts: TeamFacts) -> None:
        self.conditions = {split_owner(name)[0]: None for name in facts.conditions.names()}
        self.nodes: dict[int, None] = {}
        self.child_results: dict[tuple[int, int], None] = {}
        self._facts = facts
        # Only then does a task's status depend on claims.
        self._reads_claims = facts.mission.has_paper_policy
        # Nodes of which somebody has told a failure: who else is capable matters there.
        self._failed_nodes: dict[int, None] = {}
        for entry in facts.map:
            self._note_failure(entry)
        facts.map.subscribe(self._note)

    def __bool__(self) -> bool:
        return bool(self.conditions or self.nodes or self.child_results)

    def clear(self) -> None:
        """Begin anew."""
        self.conditions.clear()
        self.nodes.clear()
        self.child_results.clear()

    def _note(self, changes: Sequence[Change]) -> None:
        for old, new in changes:
            self._note_change(old, new)

    def _note_change(self, old: Entry | None, new: Entry | None) -> None:
        entry = new or old
        assert entry is not None
        kind, *rest = entry.parts
        if kind in (records.CONDITION, records.EXPRESSION):
            self.conditions[split_owner(rest[0])[0]] = None
        elif kind == records.CHILD_RESULT:
            self.child_results[parse_activation(rest[0]).node, int(rest[1])] = None
        elif kind in records.BID_KINDS:
            return  # no tree reads them
        elif kind in ACTIVATION_KINDS:
            self.nodes[parse_activation(rest[0]).node] = None
            self._note_failure(entry)
        elif kind == records.CLAIM:
            self._note_claim(old)
            self._note_claim(new)
        elif kind == records.MEMBER:
            self._note_member(old, entry)

    def _note_failure(self, entry: Entry) -> None:
        if isinstance(entry.record, Outcome) and not entry.record.success:
            self._failed_nodes[parse_activation(entry.parts[1]).node] = None

    def _note_member(self, old: Entry | None, new: Entry) -> None:
        """Who is capable has changed, or whose claim is valid."""
        before = old.record if old is not None else None
        assert isinstance(new.record, Member)
        if not isinstance(before, Member) or before.capabilities != new.record.capabilities:
            self.nodes.update(self._failed_nodes)
        self._note_claim(self._facts.map.get(new.author, records.CLAIM))

    def _note_claim(self, entry: Entry | None) -> None:
        """By the paper's policy a claim, as long as it is valid, counts as an assignment."""
        if self._reads_claims and entry is not None and isinstance(entry.record, Claim):
            try:
                self.nodes[parse_activation(entry.record.activation).node] = None
            except ValueError:
                return  # of nothing that a tree could name


# (conditions that have turned to these values, loops whose attempt number has changed)
# -> first and last nodes of ranges that hold all whose activations may have other names.
RenamedRanges = Callable[[Iterable[Guard], Iterable[int]], list[tuple[int, int]]]


class PruneCandidates:
    """Which of a team's activations may have come out of reach since it was asked last.

    Those that are new, those at nodes whose guards have turned, and those in a loop whose attempt
    number has changed.
    """

    def __init__(self, facts: TeamFacts) -> None:
        self._facts = facts
        self._at_node: dict[int, dict[str, None]] = {}
        self._nodes: list[int] = []
        self._fresh: dict[str, None] = {}
        # The revision up to which each condition's turns were looked at.
        self._revisions: dict[str, int] = {}
        self._conditions = dict.fromkeys(facts.conditions.names())
        self._loops: dict[int, None] = {}
        self._note([(None, entry) for entry in facts.map])
        facts.map.subscribe(self._note)

    def _note(self, changes: Sequence[Change]) -> None:
        for old, new in changes:
            if new is not None:
                self._note_new(*new.parts[:2])
            elif old is not None and old.parts[1] not in self._facts.activations:
                self._remove(old.parts[1])

    def _note_new(self, kind: str, name: str = "") -> None:
        if kind in (records.CONDITION, records.EXPRESSION):
            self._conditions[name] = None
        elif kind in ACTIVATION_KINDS:
            node = self._add(name)
            if kind == records.ATTEMPT:
                self._loops[node] = None

    def _add(self, name: str) -> int:
        node = parse_activation(name).node
        if node not in self._at_node:
            self._at_node[node] = {}
            insort(self._nodes, node)
        self._at_node[node][name] = None
        self._fresh[name] = None
        return node

    def _remove(self, name: str) -> None:
        node = parse_activation(name).node
        del self._at_node[node][name]
        if not self._at_node[node]:
            del self._at_node[node]
            del self._nodes[bisect_left(self._nodes, node)]

    def take(self, renamed_ranges: RenamedRanges) -> list[Activation]:
        """They are returned once."""
        if not (self._fresh or self._conditions or self._loops):
            return []
        candidates = dict(self._fresh)
        for first, last in renamed_ranges(self._turned(), self._loops):
            begin = bisect_left(self._nodes, first)
            for node in self._nodes[begin : bisect_right(self._nodes, last, begin)]:
                candidates.update(self._at_node[node])
        for changed in (self._fresh, self._conditions, self._loops):
            changed.clear()
        known = self._facts.activations
        return [known[name].activation for name in candidates if name in known]

    def _turned(self) -> list[Guard]:
        """Conditions that have turned, with the values to which they have."""
        conditions = self._facts.conditions
        turned = []
        for name in self._conditions:
            before, now = self._revisions.get(name, 0), conditions.revision(name)
            self._revisions[name] = now
            turned += [
                (name, value)
                for value in (True, False)
                if conditions.turns_at(name, value, before) != conditions.turns_at(name, value, now)
            ]
        return turned
