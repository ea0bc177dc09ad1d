"""What belongs to a robot: which action has to be done by the robot that did another one before.

A condition that every robot has for itself, such as *holding*, is made true by one action and
required by later ones: what one robot holds, no other one can place. So these are done by the same
robot, where the tree leaves no doubt which action comes before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from mrbt_mesh.analysis.effects import Declarations, guards
from mrbt_mesh.analysis.places import Placed, walk
from mrbt_mesh.core.bt.tree import Kind, NodeSpec
from mrbt_mesh.core.mission.mission import split_call
from mrbt_mesh.formats.declaration import Declaration

# A type of action -> the call that its robot has to have done, with the names of its parameters.
Templates: TypeAlias = dict[str, str]

_NOTHING = Declaration()
_THROUGH = (Kind.SEQUENCE, Kind.SUBTREE)


@dataclass(frozen=True, slots=True)
class Follows:
    """An action that requires what belongs to a robot, and the one whose robot has it.

    `before` is None where the tree does not tell which; then `reason` says why.
    """

    action: str
    condition: str
    before: str | None
    reason: str = ""


def follows(
    spec: NodeSpec, declared: Declarations, is_of_robots: Callable[[str], bool]
) -> list[Follows]:
    """For each action node that requires a robot's own condition, in tree order, each kind once."""
    nodes = [node for node in walk(spec) if node.spec.kind is Kind.ACTION]
    found = []
    for position, node in enumerate(nodes):
        does = declared.get(node.spec.subject, _NOTHING)
        for condition, value in does.requires.items():
            if value and is_of_robots(condition):
                found.append(_follows(spec, nodes[:position], node, condition, declared))
    return list(dict.fromkeys(found))


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
    """By type of action, what its robot has to have done; and what cannot be said by type."""
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
