"""Revisions: another mission in the place of the one that a team runs.

Facts name the nodes of the tree by numbers. `revise` gives the parts of the new tree the numbers of
the same parts of the missions before, so that their activations keep names, outcomes and claims.
All other nodes get numbers that were never used: what is done there begins again.

A *part* is an action, or a node that remembers (Retry, Repeat, Timeout, nodes with memory) with all
that is below it. Two parts are the same if all that their steps depend on is the same: the
global tasks, what their local tasks are and where they happen, and the conditions that guard them.
Names of nodes and parameters, the order of declarations, values of parameters that a type of jobs
has or has not, and the count of a Retry or Repeat are no part of that.

Parts that a revision removes are *retired*: the mission keeps their numbers, so that what was done
is done still when a later revision has them again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from mrbt_mesh.core.bt.evaluator import Evaluator
from mrbt_mesh.core.bt.guards import Guard, conditions_in
from mrbt_mesh.core.bt.tree import ATTEMPT_KINDS, Kind, Memory, Node, Tree
from mrbt_mesh.core.mission.jobs import type_at
from mrbt_mesh.core.mission.mission import GlobalTask, JobType, Mission
from mrbt_mesh.core.mission.names import bound
from mrbt_mesh.features.revisions.section import (
    RetiredPart,
    Revision,
    revision_of,
    with_revision,
)

# How many parts that are in the tree no more keep their numbers.
MAX_RETIRED = 1_000
_REMEMBERING = ATTEMPT_KINDS | {Kind.TIMEOUT}
_COUNTED = frozenset({Kind.RETRY, Kind.REPEAT})
_IN_ANY_ORDER = frozenset({Kind.SEQUENCE, Kind.FALLBACK})


class RevisionError(ValueError):
    """Why a mission cannot take the place of another one, in words for the operator."""


def revise(before: Mission, after: Mission, number: int | None = None) -> Mission:
    """`after` as the revision that follows `before`, with the numbers of parts that are the same.

    `number`: that of the revision, None: the next one. Raises RevisionError if a team cannot go
    from one to the other.
    """
    _check(before, after)
    known = revision_of(before)
    old, new = _Parts(before), _Parts(after)
    numbering = _Numbering(before, old, new)
    unused = len(before.tree.nodes) if known is None else known.next_node
    numbers = []
    for node in after.tree.nodes:
        if node.index not in numbering.number_of:
            numbering.number_of[node.index] = unused
            unused += 1
        numbers.append(numbering.number_of[node.index])
    retired = [each for each in numbering.candidates if each not in numbering.taken]
    revision = Revision(
        before.number + 1 if number is None else number,
        before.team_digest,
        unused,
        tuple(numbers),
        tuple(retired[max(0, len(retired) - MAX_RETIRED) :]),
    )
    return with_revision(after, revision)


def _check(before: Mission, after: Mission) -> None:
    """A condition's revisions count from its default, so that must stay."""
    for name, condition in sorted(after.conditions.items()):
        known = before.conditions.get(name)
        if known is not None and known != condition:
            raise RevisionError(
                f"{after.entries.called(name)} is declared otherwise than in the mission that "
                "runs: keep it as it is there, or declare one of another name"
            )


@dataclass(frozen=True, slots=True)
class _Part:
    """`nodes`: the indices of its nodes, without those that only name their child; `guards`: of the
    nodes whose conditions decide together whether it is reached. `key`: a hash of all that its
    steps depend on.
    """

    key: str
    nodes: tuple[int, ...]
    guards: tuple[int, ...]


class _Numbering:
    """Gives the nodes of a new tree the numbers of the same parts before.

    `candidates`: the parts that were retired before, and then those of the tree, by number;
    `taken`: those that the new tree has. Of several that are the same the order decides, first of
    those in the tree before.
    """

    def __init__(self, before: Mission, old: _Parts, new: _Parts) -> None:
        self.number_of: dict[int, int] = {}
        self._index_of: dict[int, int] = {}
        nodes = before.tree.nodes
        present = [
            RetiredPart(
                part.key,
                tuple(nodes[index].number for index in part.nodes),
                tuple(nodes[index].number for index in part.guards),
            )
            for part in old.parts
        ]
        known = revision_of(before)
        retired = known.retired if known is not None else ()
        self.candidates = [*retired, *present]
        self.taken = set[RetiredPart]()
        by_key: dict[str, list[RetiredPart]] = {}
        for each in (*present, *retired):
            by_key.setdefault(each.key, []).append(each)
        for part in new.parts:
            for each in by_key.get(part.key, ()):
                if each not in self.taken and self._take(part, each):
                    break
        self._number_the_rest(before, old, new)

    def _take(self, part: _Part, known: RetiredPart) -> bool:
        """Give a part these numbers; False if others have them, or its guards have others."""
        pairs = [*zip(part.nodes, known.nodes, strict=False)]
        pairs += zip(part.guards, known.guards, strict=False)
        if any(
            self.number_of.get(index, number) != number
            or self._index_of.get(number, index) != index
            for index, number in pairs
        ):
            return False
        self.taken.add(known)
        self.number_of.update(pairs)
        self._index_of.update((number, index) for index, number in pairs)
        return True

    def _number_the_rest(self, before: Mission, old: _Parts, new: _Parts) -> None:
        """Nodes that are no part, so that there are no facts of them: as before if they look so."""
        reserved = {number for each in self.candidates for number in (*each.nodes, *each.guards)}
        known: dict[tuple[str, str], list[int]] = {}
        for index, looks in old.others():
            known.setdefault(looks, []).append(before.tree.nodes[index].number)
        for index, looks in new.others():
            free = known.get(looks)
            while index not in self.number_of and free:
                number = free.pop(0)
                if number not in self._index_of and number not in reserved:
                    self.number_of[index] = number
                    self._index_of[number] = index


class _Parts:
    """The parts of a mission's tree, in the order of the tree."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._nodes = mission.tree.nodes
        # Guards name nodes by their numbers: here these are the indices.
        self._tree = mission.tree.with_numbers(range(len(self._nodes)))
        self._evaluator = Evaluator(self._tree)
        self._texts: dict[tuple[int, bool], str] = {}

    @cached_property
    def parts(self) -> list[_Part]:
        return [
            self._part(node)
            for node, part in zip(self._nodes, parts_of(self._tree), strict=True)
            if part == node.index and (node.kind is Kind.ACTION or _remembers(node))
        ]

    def others(self) -> Iterator[tuple[int, tuple[str, str]]]:
        """The nodes that are in no part, with the job type to which each belongs and its text."""
        inside = {index for part in self.parts for index in part.nodes}
        for node in self._nodes:
            if node.index not in inside:
                yield node.index, (self._type_name(node.index), self._text(node.index, True))

    def _part(self, node: Node) -> _Part:
        guards = sorted(self._guard(node, guard) for guard in self._evaluator.guards_of[node.index])
        key = (
            self._type_name(node.index),
            self._text(node.index, is_sorted=False),
            tuple(text for text, _ in guards),
        )
        below = _below(self._nodes, node.index)
        return _Part(
            hashlib.blake2b(repr(key).encode(), digest_size=8).hexdigest(),
            tuple(index for index in below if self._nodes[index].kind is not Kind.SUBTREE),
            tuple(index for _, index in guards if index >= 0),
        )

    def _guard(self, node: Node, guard: Guard) -> tuple[str, int]:
        """What a guard reads and the value that it must not have, as a text; and the node whose
        number is in its name, -1: it has none.
        """
        name, value = guard
        if not name.startswith("#"):
            return repr((self._bound(node.index, name), value, self._robots({name}))), -1
        key, _, rest = name[1:].partition(":")
        index = int(key)
        read = self._nodes[index]
        if rest.isdecimal():
            children = read.children[: int(rest)]
            texts = sorted(self._text(child, True) for child in children)
            names = {name for each in children for name in conditions_in(self._tree.spec(each))}
            return repr((str(read.kind), texts, value, self._robots(names))), index
        names = conditions_in(self._tree.spec(index))
        return repr((self._text(index, True), rest, value, self._robots(names))), index

    def _robots(self, conditions: set[str]) -> list[str]:
        """The robots of the mission, if each has one of these conditions for itself."""
        has_own = any(map(self._mission.entries.is_own, conditions))
        return sorted(self._mission.robots) if has_own else []

    def _text(self, index: int, is_sorted: bool) -> str:
        """What the subtree at a node does. `is_sorted`: conditions that decide together are in any
        order.
        """
        found = self._texts.get((index, is_sorted))
        if found is None:
            found = self._texts[index, is_sorted] = self._make_text(self._nodes[index], is_sorted)
        return found

    def _make_text(self, node: Node, is_sorted: bool) -> str:
        if node.kind is Kind.ACTION:
            return self._task_text(node)
        if node.kind is Kind.CONDITION:
            return f"?{self._bound(node.index, node.subject)}"
        children = [self._text(child, is_sorted) for child in node.children]
        if node.kind is Kind.SUBTREE:
            return children[0]
        if is_sorted and node.kind in _IN_ANY_ORDER and not self._evaluator.has_action[node.index]:
            children.sort()
        limit = 0 if node.kind in _COUNTED else node.limit
        own = (str(node.kind), limit, node.timeout_us, str(node.memory), node.failures)
        return f"{own}[{', '.join(children)}]"

    def _task_text(self, node: Node) -> str:
        """A global task as its steps depend on it, with positions for names of parameters."""
        kind = type_at(self._mission, node.index)
        of_type = kind.global_tasks.get(node.subject) if kind is not None else None
        task = of_type or self._mission.global_tasks[node.subject]
        policies = replace(task, id="", needs=(), effects=())
        needs = sorted(self._need_texts(task, kind, node.index))
        return repr((self._bound(node.index, task.id), policies, needs))

    def _need_texts(self, task: GlobalTask, kind: JobType | None, index: int) -> Iterator[str]:
        mission, travel = self._mission, self._mission.travel
        for need in task.needs:
            name = need.local_task
            of_type = kind or _NO_TYPE
            program = of_type.program_trees.get(name) or mission.program_trees.get(name)
            at = of_type.at.get(name) or (travel.at.get(name, "") if travel is not None else "")
            content = (
                need,
                at,
                program and (program.xml, program.tree, program.ports, program.outputs),
            )
            yield self._bound(index, repr(content))

    def _bound(self, index: int, text: str) -> str:
        """A text of a job type with the places of parameters in the place of their names."""
        kind = type_at(self._mission, index)
        if kind is None:
            return text
        return bound(text, {each.name: f"<{n}>" for n, each in enumerate(kind.parameters, 1)})

    def _type_name(self, index: int) -> str:
        kind = type_at(self._mission, index)
        return kind.name if kind is not None else ""


_NO_TYPE = JobType("")


def parts_of(tree: Tree) -> list[int]:
    """By node: the outermost node that remembers, at or above it; the node itself if none does."""
    found: list[int] = []
    for node in tree.nodes:
        above = found[node.parent] if node.parent >= 0 else -1
        is_inside = above >= 0 and _remembers(tree.nodes[above])
        found.append(above if is_inside else node.index)
    return found


def _remembers(node: Node) -> bool:
    return node.kind in _REMEMBERING or node.memory is not Memory.NONE


def _below(nodes: tuple[Node, ...], index: int) -> Iterator[int]:
    """A node, and all below it, in the order of the tree."""
    yield index
    for child in nodes[index].children:
        yield from _below(nodes, child)
