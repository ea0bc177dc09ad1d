"""Parameters, for-each loops and subtrees of a tree: first checked, then expanded to ground.

`read_template` turns the pydantic models into one small recursive form. `check_template`
finds what is wrong whatever the values are, once per place. `Expander` puts values in.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, TypeAlias

from mrbt_mesh.core.bt.tree import CONTROLS, LEAVES, MAX_DEPTH, MAX_NODES, Kind, Memory, NodeSpec
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.tree_model import CompositeModel, NodeModel, ParallelModel

Scope: TypeAlias = Mapping[str, Any]
_REFERENCE = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")
_ARGUMENT = re.compile(ARGUMENT_PATTERN)


class TooManyNodesError(Exception):
    """The tree would have more than `MAX_NODES` nodes; expansion stopped there."""


@dataclass(frozen=True, slots=True)
class Template:
    """A node of the file, before expansion; `path` is its place in the file.

    `text` is the call of a leaf or SubTree. `children` come first, then `loop` once per
    combination of the values of `for_each`, of which the first changes slowest.
    """

    path: SourcePath
    kind: Kind
    text: str = ""
    name: str = ""
    children: tuple[Template, ...] = ()
    for_each: tuple[tuple[str, Any], ...] = ()
    loop: tuple[Template, ...] = ()
    success: str | int = "all"
    limit: int = 0
    timeout_us: int = 0
    memory: Memory = Memory.NONE
    failures: int = 0


def to_micro(value: float) -> int:
    """Exactly `value` millionths; raises ValueError if it has more than 6 decimals."""
    micro = Decimal(str(value)) * MICRO
    if micro != int(micro):
        raise ValueError(f"a number with at most 6 decimals is expected, found {value!r}")
    return int(micro)


def argument_text(value: Any) -> str:
    """A value as an argument: 1 -> "1", True -> "true". Raises ValueError if it cannot be one."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str | int | float):
        text = str(value)
    else:
        raise ValueError(f"an argument is text or a number, found {found(value)}")
    if _ARGUMENT.fullmatch(text) is None:
        allowed = "1 to 64 letters, digits, _, ., + or -"
        raise ValueError(f"an argument has {allowed}, found {found(text)}")
    return text


def split_template(text: str) -> tuple[str, tuple[str, ...]]:
    """`fix_hw($part, left)` -> ("fix_hw", ("$part", "left")); the shape was checked before."""
    name, _, rest = text.partition("(")
    if not rest:
        return name, ()
    return name, tuple(argument.strip() for argument in rest[:-1].split(","))


def call_text(name: str, arguments: Iterable[str]) -> str:
    """The ground name: ("fix_hw", ["2"]) -> `fix_hw(2)`."""
    inside = ",".join(arguments)
    return f"{name}({inside})" if inside else name


def substitute(argument: str, scope: Scope) -> Any:
    """The value of an argument. A whole `$name` keeps its type, lists included.

    Raises ValueError for a name inside longer text whose value cannot be an argument.
    """
    whole = _REFERENCE.fullmatch(argument)
    if whole is not None:
        return scope[whole[1]]
    return _REFERENCE.sub(lambda match: argument_text(scope[match[1]]), argument)


def ground_call(text: str, scope: Scope) -> tuple[str, list[str]]:
    """A call with its arguments filled in, and these. Raises ValueError if one cannot be."""
    name, templates = split_template(text)
    arguments = [argument_text(substitute(template, scope)) for template in templates]
    return call_text(name, arguments), arguments


def read_template(node: str | NodeModel, path: SourcePath, report: Report) -> Template:
    """The small form of a node of the file."""
    if isinstance(node, str):
        return Template(path, Kind.ACTION, text=node)
    kind, body = node.kind_and_body()
    here = (*path, str(kind))
    if kind in LEAVES or kind is Kind.SUBTREE:
        return Template(here, kind, text=body)
    if kind in CONTROLS:
        return _read_control(kind, body, here, report)
    if kind is Kind.RETRY or kind is Kind.REPEAT:
        limit = body.attempts if kind is Kind.RETRY else body.cycles
        child = read_template(body.do, (*here, "do"), report)
        return Template(here, kind, name=body.name or "", children=(child,), limit=limit)
    if kind is Kind.TIMEOUT:
        child = read_template(body.do, (*here, "do"), report)
        micro = micro_or_report(body.seconds, (*here, "seconds"), report)
        return Template(here, kind, name=body.name or "", children=(child,), timeout_us=micro)
    return Template(here, kind, children=(read_template(body, here, report),))


def micro_or_report(value: float, path: SourcePath, report: Report) -> int:
    """`to_micro`, with the problem in the report and 1 in its place."""
    try:
        return to_micro(value)
    except ValueError as error:
        report.add(path, str(error))
        return 1


def _read_control(
    kind: Kind, body: list[str | NodeModel] | CompositeModel, path: SourcePath, report: Report
) -> Template:
    if isinstance(body, list):
        listed = (read_template(node, (*path, i), report) for i, node in enumerate(body))
        return Template(path, kind, children=tuple(listed))
    do = body.do if isinstance(body.do, list) else [body.do] if body.do is not None else []
    inside: SourcePath = (*path, "do")
    loop = tuple(
        read_template(node, (*inside, i) if isinstance(body.do, list) else inside, report)
        for i, node in enumerate(do)
    )
    children = (
        read_template(node, (*path, "children", i), report) for i, node in enumerate(body.children)
    )
    return Template(
        path,
        kind,
        name=body.name or "",
        children=tuple(children),
        for_each=tuple((body.for_each or {}).items()),
        loop=loop,
        success=body.success if isinstance(body, ParallelModel) else "all",
        memory=Memory(body.memory),
        failures=(body.failures or 0) if isinstance(body, ParallelModel) else 0,
    )


@dataclass(frozen=True)
class Declared:
    """The parameters of everything that a tree may name, and what a leaf or SubTree names."""

    actions: Mapping[str, Sequence[str]]
    conditions: Mapping[str, Sequence[str]]
    subtrees: Mapping[str, Sequence[str]]
    words: tuple[str, str, str] = ("global task", "condition", "subtree")

    def table(self, kind: Kind) -> tuple[str, Mapping[str, Sequence[str]]]:
        """What a leaf or SubTree of this kind names, and the declared ones."""
        position = (Kind.ACTION, Kind.CONDITION, Kind.SUBTREE).index(kind)
        return self.words[position], (self.actions, self.conditions, self.subtrees)[position]


def check_templates(
    trees: Mapping[str, tuple[str | NodeModel, SourcePath]],
    declared: Declared,
    parameters: Scope,
    report: Report,
) -> dict[str, tuple[Sequence[str], Template]]:
    """The parameters and templates of the subtrees that `declared` names, checked."""
    found: dict[str, tuple[Sequence[str], Template]] = {}
    for name, (tree, path) in trees.items():
        body = read_template(tree, path, report)
        own = declared.subtrees[name]
        check_template(body, declared, frozenset(parameters) | set(own), report)
        found[name] = (own, body)
    check_cycles({name: body for name, (_, body) in found.items()}, report)
    return found


def check_template(
    template: Template, declared: Declared, scope: frozenset[str], report: Report
) -> None:
    """Report unknown names, wrong numbers of arguments and unknown `$parameters`."""
    if template.text:
        what, table = declared.table(template.kind)
        name, _ = split_template(template.text)
        if template.kind is Kind.ACTION and name not in table and name in declared.conditions:
            message = f"{name!r} is a condition; write {{Condition: {template.text}}}"
            report.add(template.path, message)
        elif template.kind is Kind.ACTION and name not in table and name in declared.subtrees:
            message = f"{name!r} is a tree itself; write {{SubTree: {template.text}}}"
            report.add(template.path, message)
        else:
            check_call(template.text, what, table, scope, template.path, report)
    check_references(template.name, scope, (*template.path, "name"), report)
    for child in template.children:
        check_template(child, declared, scope, report)
    for variable, values in template.for_each:
        if isinstance(values, str):
            check_references(values, scope, (*template.path, "for_each", variable), report)
    inner = scope | {variable for variable, _ in template.for_each}
    for child in template.loop:
        check_template(child, declared, inner, report)


def check_call(
    text: str,
    what: str,
    table: Mapping[str, Sequence[str]],
    scope: frozenset[str],
    path: SourcePath,
    report: Report,
) -> None:
    """Report a call of something undeclared, or with wrong arguments; `what` names the kind."""
    name, arguments = split_template(text)
    if name not in table:
        report.add(path, f"{name!r} is no declared {what}{nearest(name, table)}")
    elif len(arguments) != len(table[name]):
        wanted = table[name]
        listed = f" ({', '.join(wanted)})" if wanted else ""
        plural = "argument" if len(wanted) == 1 else "arguments"
        counts = f"takes {len(wanted)} {plural}{listed}, found {len(arguments)}"
        report.add(path, f"{what} {name!r} {counts}")
    for argument in arguments:
        check_references(argument, scope, path, report)
        if "$" in _REFERENCE.sub("", argument):
            report.add(path, f"a $ needs a parameter's name after it, found {argument!r}")


def check_references(text: str, scope: frozenset[str], path: SourcePath, report: Report) -> None:
    """Report every `$name` in `text` that is no parameter here."""
    for name in _REFERENCE.findall(text):
        if name not in scope:
            report.add(path, f"unknown parameter ${name}{nearest(name, scope)}")


def subtree_calls(template: Template) -> Iterator[Template]:
    """The SubTree nodes inside a template."""
    if template.kind is Kind.SUBTREE:
        yield template
    for child in (*template.children, *template.loop):
        yield from subtree_calls(child)


def check_cycles(subtrees: Mapping[str, Template], report: Report) -> None:
    """Report every cycle of subtrees once, at the call that closes it."""
    done: set[str] = set()
    for start in subtrees:
        # An own stack: a chain of subtrees may be longer than Python's.
        trail: list[tuple[str, Iterator[Template]]] = []
        if start not in done:
            trail.append((start, subtree_calls(subtrees[start])))
        while trail:
            name, calls = trail[-1]
            call = next(calls, None)
            if call is None:
                done.add(name)
                trail.pop()
                continue
            target, _ = split_template(call.text)
            names = [on_trail for on_trail, _ in trail]
            if target in names:
                cycle = " -> ".join([*names[names.index(target) :], target])
                report.add(call.path, f"cycle of subtrees: {cycle}; a subtree cannot hold itself")
            elif target in subtrees and target not in done:
                trail.append((target, subtree_calls(subtrees[target])))


@dataclass
class Expander:
    """Puts values into checked templates. Problems go to the report.

    `global_calls` collects the ground global tasks that were mentioned, in tree order,
    with their arguments and the place of the first mention.
    """

    subtrees: Mapping[str, tuple[Sequence[str], Template]]
    parameters: Scope
    report: Report
    global_calls: dict[str, tuple[str, tuple[str, ...], SourcePath]] = field(default_factory=dict)
    nodes: int = 0

    def expand(self, template: Template, scope: Scope, depth: int = 1) -> NodeSpec | None:
        """The ground node, or None after a problem. Raises TooManyNodesError."""
        self.nodes += 1
        if self.nodes > MAX_NODES:
            message = f"the tree has more than {MAX_NODES} nodes once expanded"
            self.report.add(template.path, message)
            raise TooManyNodesError
        if depth > MAX_DEPTH:
            self.report.add(template.path, f"the tree is deeper than {MAX_DEPTH} levels here")
            return None
        try:
            if template.kind in LEAVES:
                return self._leaf(template, scope)
            if template.kind is Kind.SUBTREE:
                return self._subtree(template, scope, depth)
            return self._inner(template, scope, depth)
        except ValueError as error:
            self.report.add(template.path, str(error))
            return None

    def _leaf(self, template: Template, scope: Scope) -> NodeSpec:
        subject, values = ground_call(template.text, scope)
        if template.kind is Kind.ACTION:
            call = (split_template(template.text)[0], tuple(values), template.path)
            self.global_calls.setdefault(subject, call)
        return NodeSpec(template.kind, subject=subject)

    def _subtree(self, template: Template, scope: Scope, depth: int) -> NodeSpec | None:
        name, arguments = split_template(template.text)
        values = [substitute(argument, scope) for argument in arguments]
        parameters, body = self.subtrees[name]
        inner = {**self.parameters, **dict(zip(parameters, values, strict=True))}
        child = self.expand(body, inner, depth + 1)
        title = call_text(name, (_title_text(value) for value in values))
        return child and NodeSpec(Kind.SUBTREE, (child,), name=title)

    def _inner(self, template: Template, scope: Scope, depth: int) -> NodeSpec | None:
        children = [self.expand(child, scope, depth + 1) for child in template.children]
        for inner in self._rounds(template, scope):
            children += [self.expand(child, inner, depth + 1) for child in template.loop]
        ground = tuple(child for child in children if child is not None)
        if len(ground) < len(children):
            return None
        if not ground:
            raise ValueError("no children: every list that for_each goes over is empty")
        name = _REFERENCE.sub(lambda match: _title_text(scope[match[1]]), template.name)
        limit = template.limit
        if template.kind is Kind.PARALLEL:
            limit = _needed_successes(template.success, len(ground))
        timeout_us, memory = template.timeout_us, template.memory
        failures = template.failures
        if failures > len(ground):
            count = len(ground)
            raise ValueError(f"failures: {failures} is more than the {count} children")
        return NodeSpec(template.kind, ground, name, "", limit, timeout_us, memory, failures)

    def _rounds(self, template: Template, scope: Scope) -> Iterator[Scope]:
        if not template.for_each:
            return
        lists = []
        for variable, given in template.for_each:
            values = substitute(given, scope) if isinstance(given, str) else given
            if not isinstance(values, list):
                shown = f"{given} is {found(values)}" if isinstance(given, str) else found(values)
                raise ValueError(f"for_each {variable}: a list is expected, but {shown}")
            lists.append(values)
        names = [variable for variable, _ in template.for_each]
        for values in itertools.product(*lists):
            yield {**scope, **dict(zip(names, values, strict=True))}


def _needed_successes(success: str | int, count: int) -> int:
    if success == "all":
        return count
    needed = 1 if success == "any" else int(success)
    if needed > count:
        raise ValueError(f"success: {needed} is more than the {count} children; use 1 to {count}")
    return needed


def _title_text(value: Any) -> str:
    if isinstance(value, list):
        return "[" + " ".join(_title_text(item) for item in value) + "]"
    try:
        return argument_text(value)
    except ValueError:
        return "..."
