"""Check the parameters, for-each loops and subtrees of a tree, then expand it to ground nodes.

`read_template` turns the pydantic models into one small recursive form. `check_template` finds what
is wrong whatever the values are, once per place. `Expander` puts values in.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any, Protocol, TypeAlias

from mrbt_mesh.core.bt.tree import CONTROLS, LEAVES, MAX_DEPTH, MAX_NODES, Kind, Memory, NodeSpec
from mrbt_mesh.core.mission.jobs import may_be_above_jobs
from mrbt_mesh.core.mission.mission import MICRO
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_NAME
from mrbt_mesh.errors import nearest
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.tree_model import (
    ALL_TYPES,
    CompositeModel,
    JobsModel,
    NodeModel,
    ParallelModel,
    split_comparison,
)

Scope: TypeAlias = Mapping[str, Any]
_REFERENCE = re.compile(r"\$([A-Za-z_][A-Za-z0-9_]*)")
_ARGUMENT = re.compile(ARGUMENT_PATTERN)


class TooManyNodesError(Exception):
    """The tree would have more than `MAX_NODES` nodes; expansion stopped there."""


@dataclass(frozen=True, slots=True)
class Template:
    """A node of the file, before expansion; `path` is its place in the file.

    `text` is the call of a leaf or SubTree. `jobs` are the types that a Jobs node names, with their
    places in the file; empty means all types. `children` come first, then `loop` once per
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
    jobs: tuple[tuple[str, SourcePath], ...] = ()


class Placeholder(str):
    """A text with parameters of a job that have no values yet: `{from}`, `shelf_{number}`.

    `longest` is the largest number of characters that the text can have with values. `ends` is
    empty unless the text is a single parameter; then it holds the parameter's choices, or its least
    and largest number.
    """

    longest: int
    ends: tuple[str, ...]

    def __new__(cls, text: str, longest: int, ends: tuple[str, ...] = ()) -> Placeholder:
        found = super().__new__(cls, text)
        found.longest, found.ends = longest, ends
        return found


class EntryArgument(str):
    """Stands for the value of a blackboard entry where a task reads it: `$found`.

    `problem` tells why no task can read it there; empty if one can. `is_of_job`: each job has its
    own entry.
    """

    problem: str
    is_of_job: bool

    def __new__(cls, name: str, problem: str = "", is_of_job: bool = False) -> EntryArgument:
        found = super().__new__(cls, f"${name}")
        found.problem, found.is_of_job = problem, is_of_job
        return found


def to_micro(value: float) -> int:
    """Return `value` in millionths; raises ValueError if it has more than 6 decimals."""
    micro = Decimal(str(value)) * MICRO
    if micro != int(micro):
        raise ValueError(f"a number with at most 6 decimals is expected, found {value!r}")
    return int(micro)


def argument_text(value: Any) -> str:
    """Return a value as an argument: 1 -> "1", True -> "true". Raises ValueError if it cannot be
    one.
    """
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str | int | float):
        text = str(value)
    else:
        raise ValueError(f"an argument is text or a number, found {found(value)}")
    if isinstance(value, EntryArgument):
        if value.problem:
            raise ValueError(value.problem)
        return value
    if isinstance(value, Placeholder):
        if value.longest > MAX_NAME:
            longest = f"{value} becomes a text of up to {value.longest} characters"
            raise ValueError(f"an argument has at most {MAX_NAME} characters, but {longest}")
        return value
    if _ARGUMENT.fullmatch(text) is None:
        allowed = "1 to 64 letters, digits, _, ., + or -"
        raise ValueError(f"an argument has {allowed}, found {found(text)}")
    return text


def split_template(text: str) -> tuple[str, tuple[str, ...]]:
    """Split a call whose shape was checked: `fix_hw($part, left)` -> ("fix_hw", ("$part",
    "left")).
    """
    name, _, rest = text.partition("(")
    if not rest:
        return name, ()
    return name, tuple(argument.strip() for argument in rest[:-1].split(","))


def call_text(name: str, arguments: Iterable[str]) -> str:
    """Return the ground name: ("fix_hw", ["2"]) -> `fix_hw(2)`."""
    inside = ",".join(arguments)
    return f"{name}({inside})" if inside else name


def substitute(argument: str, scope: Scope) -> Any:
    """Return the value of an argument. A whole `$name` keeps its type, lists included.

    Raises ValueError for a name inside longer text whose value cannot be an argument.
    """
    whole = _REFERENCE.fullmatch(argument)
    if whole is not None:
        return scope[whole[1]]
    parts = _REFERENCE.split(argument)
    parts[1::2] = [argument_text(scope[name]) for name in parts[1::2]]
    return _joined(parts)


def _joined(parts: Sequence[str]) -> str:
    """Join the parts of a text. The result is a placeholder if any part is one."""
    text = "".join(parts)
    if any(isinstance(part, EntryArgument) for part in parts):
        raise ValueError(f"{text} is more than the blackboard entry, which is a whole argument")
    if not any(isinstance(part, Placeholder) for part in parts):
        return text
    lengths = (part.longest if isinstance(part, Placeholder) else len(part) for part in parts)
    return Placeholder(text, sum(lengths))


def ground_call(text: str, scope: Scope) -> tuple[str, list[str]]:
    """Return a call with its arguments filled in, and the arguments.

    Raises ValueError if an argument cannot be filled in.
    """
    name, templates = split_template(text)
    arguments = [argument_text(substitute(template, scope)) for template in templates]
    return call_text(name, arguments), arguments


def read_template(node: str | NodeModel, path: SourcePath, report: Report) -> Template:
    """Return the template of a node of the file."""
    if isinstance(node, str):
        return Template(path, Kind.ACTION, text=node)
    kind, body = node.kind_and_body()
    here = (*path, str(kind))
    if kind in LEAVES or kind is Kind.SUBTREE:
        return Template(here, kind, text=body)
    if kind in CONTROLS:
        return _read_control(kind, body, here, report)
    if kind is Kind.JOBS:
        return _read_jobs(body, here)
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
    """Return `to_micro(value)`. On an error, report the problem and return 1 instead."""
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


def _read_jobs(body: str | list[str] | JobsModel, path: SourcePath) -> Template:
    types, here = (body.types, (*path, "types")) if isinstance(body, JobsModel) else (body, path)
    limit = (body.at_most or 0) if isinstance(body, JobsModel) else 0
    if isinstance(types, str):
        named: list[tuple[str, SourcePath]] = [] if types == ALL_TYPES else [(types, here)]
    else:
        named = [(name, (*here, i)) for i, name in enumerate(types)]
    return Template(path, Kind.JOBS, limit=limit, jobs=tuple(named))


class Comparisons(Protocol):
    """The comparisons with blackboard entries that the conditions of a tree may contain."""

    def checks(self, text: str, scope: frozenset[str], path: SourcePath) -> bool:
        """Check a condition of a tree if it reads an entry. Returns whether it does."""
        ...

    def ground(self, text: str, scope: Scope, is_in_job: bool) -> str:
        """Return a checked comparison with its values. Raises ValueError for an invalid one."""
        ...


@dataclass(frozen=True)
class Declared:
    """The parameters of everything that a leaf or SubTree of a tree may name.

    `jobs` are the types of jobs, None in a tree that cannot contain jobs. `comparisons` are those
    with the team's blackboard, in a tree that may have them.
    """

    actions: Mapping[str, Sequence[str]]
    conditions: Mapping[str, Sequence[str]]
    subtrees: Mapping[str, Sequence[str]]
    jobs: Collection[str] | None = None
    comparisons: Comparisons | None = None

    def table(self, kind: Kind) -> tuple[str, Mapping[str, Sequence[str]]]:
        """Return what a leaf or SubTree of this kind names, and the declared names with
        parameters.
        """
        if kind is Kind.ACTION:
            return "global task", self.actions
        if kind is Kind.CONDITION:
            return "condition", self.conditions
        return "subtree", self.subtrees


def check_templates(
    trees: Mapping[str, tuple[str | NodeModel, SourcePath]],
    declared: Declared,
    parameters: Scope,
    report: Report,
) -> dict[str, tuple[Sequence[str], Template]]:
    """Check the subtrees that `declared` names. Returns the parameters and template of each."""
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
    board = declared.comparisons if template.kind is Kind.CONDITION else None
    if template.text and (board is None or not board.checks(template.text, scope, template.path)):
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
    if template.kind is Kind.JOBS:
        _check_jobs(template, declared.jobs, report)
    check_references(template.name, scope, (*template.path, "name"), report)
    for child in template.children:
        check_template(child, declared, scope, report)
    for variable, values in template.for_each:
        if isinstance(values, str):
            check_references(values, scope, (*template.path, "for_each", variable), report)
    inner = scope | {variable for variable, _ in template.for_each}
    for child in template.loop:
        check_template(child, declared, inner, report)


def _check_jobs(template: Template, known: Collection[str] | None, report: Report) -> None:
    if known is None:
        message = "Jobs is a node of the team's tree; a tree inside it holds no other jobs"
        report.add(template.path, message)
        return
    if not known:
        example = "jobs: {count: {tree: count_shelf}}"
        report.add(template.path, f"there are no types of jobs; declare one, e.g. {example}")
    for name, path in template.jobs:
        if name not in known:
            report.add(path, f"{name!r} is not a declared job type{nearest(name, known)}")


def check_call(
    text: str,
    what: str,
    table: Mapping[str, Sequence[str]],
    scope: frozenset[str],
    path: SourcePath,
    report: Report,
) -> None:
    """Report a call of an undeclared name or with wrong arguments; `what` names the kind."""
    name, arguments = split_template(text)
    if name not in table:
        report.add(path, f"{name!r} is not a declared {what}{nearest(name, table)}")
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
    """Report every `$name` in `text` that is not a parameter here."""
    for name in _REFERENCE.findall(text):
        if name not in scope:
            report.add(path, f"unknown parameter ${name}{nearest(name, scope)}")


def subtree_calls(template: Template) -> Iterator[Template]:
    """Yield the SubTree nodes inside a template."""
    if template.kind is Kind.SUBTREE:
        yield template
    for child in (*template.children, *template.loop):
        yield from subtree_calls(child)


def check_cycles(subtrees: Mapping[str, Template], report: Report) -> None:
    """Report every cycle of subtrees once, at the call that closes it."""
    done: set[str] = set()
    for start in subtrees:
        # An explicit stack, because a chain of subtrees may exceed Python's recursion limit.
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


LocalCalls: TypeAlias = Mapping[str, Sequence[str]]
Calls: TypeAlias = dict[str, tuple[str, tuple[str, ...], SourcePath]]


@dataclass
class JobTree:
    """The tree of a job type, with a placeholder for each parameter.

    `calls` is like `Expander.global_calls`, for names with placeholders. `is_placed` is true once a
    Jobs node has the type.
    """

    template: Template
    placeholders: Mapping[str, Placeholder]
    calls: Calls = field(default_factory=dict)
    is_placed: bool = False


@dataclass
class Expander:
    """Puts values into checked templates. Problems go to the report.

    `global_calls` collects the ground global tasks that the tree names, in tree order, with their
    arguments and the place of the first mention. `comparisons`: as in `Declared`. `jobs` holds the
    types of jobs; at most `at_most` jobs of each are in the tree at a time, unless the Jobs node
    has its own limit.
    """

    subtrees: Mapping[str, tuple[Sequence[str], Template]]
    parameters: Scope
    report: Report
    jobs: Mapping[str, JobTree] = field(default_factory=dict)
    at_most: int = 1
    comparisons: Comparisons | None = None
    global_calls: Calls = field(default_factory=dict)
    nodes: int = 0
    _above: list[Template] = field(default_factory=list)
    _job: JobTree | None = None

    def expand(self, template: Template, scope: Scope, depth: int = 1) -> NodeSpec | None:
        """Return the ground node, or None after a problem. Raises TooManyNodesError."""
        self.nodes += 1
        if self.nodes > MAX_NODES:
            message = f"the tree has more than {MAX_NODES} nodes once expanded"
            self.report.add(template.path, message)
            raise TooManyNodesError
        if depth > MAX_DEPTH:
            self.report.add(template.path, f"the tree is deeper than {MAX_DEPTH} levels here")
            return None
        self._above.append(template)
        try:
            if template.kind in LEAVES:
                found: NodeSpec | None = self._leaf(template, scope)
            elif template.kind is Kind.SUBTREE:
                found = self._subtree(template, scope, depth)
            elif template.kind is Kind.JOBS:
                found = self._jobs(template, depth)
            else:
                found = self._inner(template, scope, depth)
        except ValueError as error:
            self.report.add(template.path, str(error))
            found = None
        self._above.pop()
        return found

    def _leaf(self, template: Template, scope: Scope) -> NodeSpec:
        if self.comparisons is not None and split_comparison(template.text) is not None:
            subject = self.comparisons.ground(template.text, scope, self._job is not None)
            return NodeSpec(template.kind, subject=subject)
        subject, values = ground_call(template.text, scope)
        read = next((value for value in values if isinstance(value, EntryArgument)), None)
        if read is not None and template.kind is Kind.CONDITION:
            raise ValueError(f"{read} of the blackboard cannot be the argument of a condition")
        if read is not None and read.is_of_job and self._job is None:
            raise ValueError(f"each job has its own {read[1:]}: only the tree of a job can read it")
        if template.kind is Kind.ACTION:
            call = (split_template(template.text)[0], tuple(values), template.path)
            of_job = [value for value in values if isinstance(value, Placeholder)]
            # Otherwise the ground name would not show the value of each parameter.
            joined = next((value for value in of_job if value.count("{") > 1), None)
            if joined is not None:
                message = f"{joined} joins parameters of a job in one argument of a global task"
                raise ValueError(f"{message}; give each an argument of its own")
            calls = self._job.calls if self._job and of_job else self.global_calls
            calls.setdefault(subject, call)
        return NodeSpec(template.kind, subject=subject)

    def _subtree(self, template: Template, scope: Scope, depth: int) -> NodeSpec | None:
        name, arguments = split_template(template.text)
        values = [substitute(argument, scope) for argument in arguments]
        parameters, body = self.subtrees[name]
        inner = {**self.parameters, **dict(zip(parameters, values, strict=True))}
        child = self.expand(body, inner, depth + 1)
        title = call_text(name, (_title_text(value) for value in values))
        return child and NodeSpec(Kind.SUBTREE, (child,), name=title)

    def _jobs(self, template: Template, depth: int) -> NodeSpec | None:
        if self._job is not None:
            raise ValueError("a job's tree holds no other jobs, and this Jobs node is part of one")
        for above in self._above[:-1]:
            if not may_be_above_jobs(above.kind, above.memory):
                kind = f"{above.kind} with memory" if above.kind in CONTROLS else str(above.kind)
                place = f"line {self.report.line(above.path)}"
                raise ValueError(f"jobs cannot be below {kind} ({place}); move the node out of it")
        children = []
        for name in [name for name, _ in template.jobs] or sorted(self.jobs):
            job = self.jobs[name]
            if job.is_placed:
                message = f"{name} is in a Jobs node already, and its jobs can be in one only"
                raise ValueError(f"{message}; name it once, and this node in no for_each")
            job.is_placed, self._job = True, job
            scope = {**self.parameters, **job.placeholders}
            child = self.expand(job.template, scope, depth + 2)
            self._job = None
            children.append(child and NodeSpec(Kind.SUBTREE, (child,), name=name))
        ground = tuple(child for child in children if child is not None)
        if len(ground) < len(children):
            return None
        return NodeSpec(Kind.JOBS, ground, limit=template.limit or self.at_most)

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
            if isinstance(values, Placeholder):
                message = f"for_each {variable}: {given} has one value, a job's own"
                raise ValueError(f"{message}; for_each goes over lists of the mission")
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
