"""What belongs to a robot: which action has to be done by the robot that did another one before.

A condition that every robot has for itself, such as *holding*, is made true by one action and
required by later ones: what one robot holds, no other one can place. Where that can be begun again
by another robot, the tree asks for the condition: Sequence(Fallback(holding, pick), carry, place).
So it is done by the robot for which it holds, and once more if that one dies. Elsewhere these are
done by the same robot, where the tree leaves no doubt which action comes before; else by a robot
for which the condition holds, which the tree then asks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from mrbt_mesh.analysis.lift.effects import Declarations, guards
from mrbt_mesh.core.bt.guards import Guards
from mrbt_mesh.core.bt.tree import CONTROLS, Kind, Memory, NodeSpec, build_tree
from mrbt_mesh.core.mission.names import split_call
from mrbt_mesh.formats.declaration import Declaration
from mrbt_mesh.formats.node_paths import Placed, walk

# A type of action -> the call that its robot has to have done, with the names of its parameters.
Templates: TypeAlias = dict[str, str]

_NOTHING = Declaration()
_THROUGH = (Kind.SEQUENCE, Kind.SUBTREE)
_TRANSPARENT = (Kind.INVERTER, Kind.FORCE_SUCCESS, Kind.FORCE_FAILURE, Kind.SUBTREE)


@dataclass(frozen=True, slots=True)
class Follows:
    """An action that requires what belongs to a robot, and the one whose robot has it.

    `before` is None if the tree does not determine it, for this `reason`.
    """

    action: str
    condition: str
    before: str | None
    reason: str = ""


def _follows(
    spec: NodeSpec, earlier: list[Placed], node: Placed, condition: str, declared: Declarations
) -> Follows:
    subject = node.spec.subject
    setters: list[Placed] = []
    for each in reversed(earlier):
        does = declared.get(each.spec.subject, _NOTHING)
        value = does.effects.get(condition)
        if value is False:
            break
        if value:
            setters.append(each)
    if not setters:
        return Follows(subject, condition, None, f"nothing before it makes {condition} true")
    if len(setters) > 1:
        names = " or ".join(sorted({each.spec.subject for each in setters}))
        return Follows(subject, condition, None, f"{names} may have made {condition} true")
    (setter,) = setters
    name = setter.spec.subject
    if not _is_certain(spec, setter.place, node.place):
        return Follows(subject, condition, None, f"{name} need not have been done before it")
    if _is_guarded_by(spec, setter.place, condition):
        return Follows(subject, condition, None, f"{condition} is asked before {name} is done")
    return Follows(subject, condition, name)


def _is_certain(spec: NodeSpec, before: tuple[int, ...], after: tuple[int, ...]) -> bool:
    """Whether the second node is only reached once the first has succeeded."""
    node, depth = spec, 0
    while before[depth] == after[depth]:
        node = node.children[before[depth]]
        depth += 1
    for position in before[depth:]:
        if node.kind not in _THROUGH:
            return False
        node = node.children[position]
    return True


def _is_guarded_by(spec: NodeSpec, place: tuple[int, ...], condition: str) -> bool:
    """Whether a node above asks the condition at every tick: then the action is renewed by it."""
    node = spec
    for position in place:
        if condition in guards(node):
            return True
        node = node.children[position]
    return False


def templates(
    found: Iterable[Follows], parameters: Callable[[str], Sequence[str]]
) -> tuple[Templates, list[Follows]]:
    """By type of action the call that its robot has to have done; and actions without one."""
    by_type: dict[str, list[Follows]] = {}
    for each in found:
        by_type.setdefault(split_call(each.action)[0], []).append(each)
    result, unsaid = {}, []
    for name, rows in by_type.items():
        texts = {_template(each, parameters(name)) for each in rows}
        first = texts.pop()
        if first and not texts:
            result[name] = first
        else:
            reason = "not every action of its type follows the same one"
            unsaid += [
                each if each.before is None else replace(each, reason=reason) for each in rows
            ]
    return result, unsaid


def _template(follows: Follows, parameters: Sequence[str]) -> str:
    """`pick($item)` for `place(item)` where `place(3)` follows `pick(3)`; empty: any robot."""
    if follows.before is None:
        return ""
    own = dict(zip(split_call(follows.action)[1], parameters, strict=True))
    name, arguments = split_call(follows.before)
    texts = [f"${own[argument]}" if argument in own else argument for argument in arguments]
    return f"{name}({', '.join(texts)})" if texts else name


# -- what can be begun again ------------------------------------------------------------------


@dataclass(frozen=True)
class Ownership:
    """What belongs to a robot, in one team. `at_first`: what conditions are before they are set."""

    declared: Declarations
    is_of_robots: Callable[[str], bool]
    at_first: Callable[[str], bool]

    def follows(self, spec: NodeSpec) -> list[Follows]:
        """For each action that requires a robot's own condition, in tree order, each kind once.

        Where the tree asks for the condition before it, the plan minds whose it is.
        """
        nodes = [node for node in walk(spec) if node.spec.kind is Kind.ACTION]
        guards_of = Guards(build_tree(spec)).guards_of
        index = {node.place: number for number, node in enumerate(walk(spec))}
        found = []
        for position, node in enumerate(nodes):
            does = self.declared.get(node.spec.subject, _NOTHING)
            for condition, value in does.requires.items():
                is_asked = (condition, False) in guards_of[index[node.place]]
                if value and self.is_of_robots(condition) and not is_asked:
                    found.append(_follows(spec, nodes[:position], node, condition, self.declared))
        return list(dict.fromkeys(found))

    def renewable(self, spec: NodeSpec, asked: Iterable[Follows] = ()) -> NodeSpec:
        """The tree, with conditions asked where another robot can fetch what a dead one held.

        `asked`: actions of which the tree does not tell whose they are; what they require is asked
        before them, so that only robots are put on them for which it holds.
        """
        before: dict[str, list[str]] = {}
        for each in asked:
            before.setdefault(each.action, []).append(each.condition)
        setters = [
            (leaf.subject, name)
            for leaf in _actions(spec)
            for name, value in self.declared.get(leaf.subject, _NOTHING).effects.items()
            if value
        ]
        return _Renewal(self, setters, before).of(spec)


@dataclass(frozen=True)
class _Renewal:
    """Rewrites a lifted tree. `setters`: (action, condition that it makes true).

    `asked`: conditions that are to be asked before an action, by its name.
    """

    own: Ownership
    setters: Sequence[tuple[str, str]]
    asked: Mapping[str, Sequence[str]]

    def of(self, spec: NodeSpec) -> NodeSpec:
        """A node of which what is above keeps how it has ended, whatever conditions do then."""
        if spec.kind is Kind.ACTION and spec.subject in self.asked:
            conditions = [NodeSpec(Kind.CONDITION, subject=c) for c in self.asked[spec.subject]]
            return NodeSpec(Kind.SEQUENCE, (*conditions, spec))
        if spec.kind in CONTROLS:
            if spec.memory is Memory.NONE and not spec.contains(Kind.CONDITION):
                spec = replace(spec, memory=Memory.WHILE_RUNNING)  # of actions it is the same
            if spec.memory is Memory.NONE:
                return spec
        elif spec.kind not in _TRANSPARENT:
            return spec
        if spec.kind is not Kind.SEQUENCE:
            return replace(spec, children=tuple(map(self.of, spec.children)))
        rows: list[NodeSpec] = []
        children = spec.children
        while children:
            last = self._last(children)
            part, children = children[: last + 1], children[last + 1 :]
            rows.append(self._together(part) if last else self.of(part[0]))
        if len(rows) == 1 and len(spec.children) > 1:
            return replace(rows[0], name=spec.name)
        return replace(spec, children=tuple(rows))

    def _last(self, children: Sequence[NodeSpec]) -> int:
        """The last of these that has to be done again with the first one if its robot dies."""
        condition = self._made(children[0])
        last = 0
        for position, child in enumerate(children[1:], start=1):
            does = [self._does(leaf) for leaf in _actions(child)]
            if condition is None or not does:
                break
            if any(condition in each.requires or condition in each.effects for each in does):
                last = position
            if any(each.effects.get(condition) is False for each in does):
                if child.kind is not Kind.ACTION:
                    return 0  # the rest of it would be begun again
                break
        return last if self._can_be_repeated(children[: last + 1], condition or "") else 0

    def _does(self, leaf: NodeSpec) -> Declaration:
        return self.own.declared.get(leaf.subject, _NOTHING)

    def _made(self, spec: NodeSpec) -> str | None:
        """The per-robot condition that an action makes true, where it was false before.

        Of Fallback(holding, pick), too: it asks for it.
        """
        if spec.kind is Kind.FALLBACK:
            asked, *others = spec.children
            is_own = asked.kind is Kind.CONDITION and self.own.is_of_robots(asked.subject)
            is_made = all(self._does(each).effects.get(asked.subject) for each in others)
            return asked.subject if is_own and others and is_made else None
        if spec.kind is not Kind.ACTION:
            return None
        does = self._does(spec)
        for condition, value in does.effects.items():
            if not value or not self.own.is_of_robots(condition):
                continue
            if does.requires.get(condition) is False:
                return condition
            makers = [action for action, made in self.setters if made == condition]
            if not self.own.at_first(condition) and makers == [spec.subject]:
                return condition
        return None

    def _can_be_repeated(self, part: Sequence[NodeSpec], own: str) -> bool:
        """Whether, after any of these, what they require still holds for another robot."""
        does = [self._does(leaf) for child in part for leaf in _actions(child)]
        required = {pair for each in does for pair in each.requires.items() if pair[0] != own}
        changed = {(name, not value) for each in does for name, value in each.effects.items()}
        asking = part if part[0].kind is Kind.ACTION else (*part[0].children[1:], *part[1:])
        leaves = (node.spec for child in asking for node in walk(child))
        asks = any(leaf.kind is Kind.CONDITION for leaf in leaves)
        reads = frozenset().union(*(each.reads for each in does))
        writes = frozenset().union(*(each.writes for each in does))
        return not (asks or required & changed or reads & writes)

    def _together(self, part: Sequence[NodeSpec]) -> NodeSpec:
        first = part[0]
        if first.kind is Kind.ACTION:
            condition = NodeSpec(Kind.CONDITION, subject=self._made(first) or "")
            first = NodeSpec(Kind.FALLBACK, (condition, first))
        first = replace(first, memory=Memory.NONE)
        return NodeSpec(Kind.SEQUENCE, (first, *part[1:]))


def _actions(spec: NodeSpec) -> list[NodeSpec]:
    return [node.spec for node in walk(spec) if node.spec.kind is Kind.ACTION]
