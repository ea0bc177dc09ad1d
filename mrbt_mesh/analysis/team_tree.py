"""Translates a BehaviorTree.CPP tree to a team's tree, or lists what a team cannot carry out.

A team's tree is a pure function of replicated facts. There is no blackboard and no script that
changes anything; what nodes with memory remember are facts.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from mrbt_mesh.analysis.team_notes import notes, returns_between_steps
from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, SWITCHES
from mrbt_mesh.btcpp.files.document import LEAVES, PRECONDITIONS, Category, Direction, pointer
from mrbt_mesh.btcpp.files.entries import access_below
from mrbt_mesh.btcpp.files.expand import ExpandedNode, ExpandedTree, expand
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.scripts.parser import parse
from mrbt_mesh.btcpp.scripts.script import (
    Binary,
    Boolean,
    Comparison,
    Expression,
    Name,
    Number,
    ScriptError,
    Unary,
)
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.core.bt.tree import Kind, Memory, NodeSpec, TreeError, build_tree
from mrbt_mesh.core.mission.names import ARGUMENT_PATTERN, MAX_ARGUMENTS, NAME_PATTERN
from mrbt_mesh.errors import Problem

# BehaviorTree.CPP's nodes, and the equivalent nodes of the core.
KINDS = {
    "ReactiveSequence": (Kind.SEQUENCE, Memory.NONE),
    "ReactiveFallback": (Kind.FALLBACK, Memory.NONE),
    "Sequence": (Kind.SEQUENCE, Memory.WHILE_RUNNING),
    "AsyncSequence": (Kind.SEQUENCE, Memory.WHILE_RUNNING),
    "Fallback": (Kind.FALLBACK, Memory.WHILE_RUNNING),
    "AsyncFallback": (Kind.FALLBACK, Memory.WHILE_RUNNING),
    "SequenceWithMemory": (Kind.SEQUENCE, Memory.UNTIL_SUCCESS),
    "Parallel": (Kind.PARALLEL, Memory.WHILE_RUNNING),
    "IfThenElse": (Kind.IF_THEN_ELSE, Memory.WHILE_RUNNING),
    "WhileDoElse": (Kind.IF_THEN_ELSE, Memory.NONE),
    "Inverter": (Kind.INVERTER, Memory.NONE),
    "ForceSuccess": (Kind.FORCE_SUCCESS, Memory.NONE),
    "ForceFailure": (Kind.FORCE_FAILURE, Memory.NONE),
    "RetryUntilSuccessful": (Kind.RETRY, Memory.NONE),
    "Repeat": (Kind.REPEAT, Memory.NONE),
    "KeepRunningUntilFailure": (Kind.KEEP_RUNNING_UNTIL_FAILURE, Memory.NONE),
    "Timeout": (Kind.TIMEOUT, Memory.NONE),
    "SubTree": (Kind.SUBTREE, Memory.NONE),
}

# Written by our own export; BehaviorTree.CPP keeps and ignores it.
REACTIVE = "_reactive"
# The condition in place of AlwaysSuccess; a mission declares it with the default true.
ALWAYS = "always"

_REASONS = {
    "ParallelAll": "it waits for all children and then counts failures; use Parallel",
    "TryCatch": "it remembers that an attempt has failed",
    "Precondition": "it asks its condition once and remembers the answer; use IfThenElse",
    "RunOnce": "it remembers what its child has returned",
    "Delay": "it waits, which only an action can do in a team's tree",
    "Sleep": "it waits, which only an action can do in a team's tree",
    "SkipUnlessUpdated": "it reads the blackboard, which a team does not share",
    "WaitValueUpdate": "it reads the blackboard, which a team does not share",
    "WasEntryUpdated": "it reads the blackboard, which a team does not share",
    "SetBlackboard": "it writes the blackboard, which a team does not share",
    "UnsetBlackboard": "it writes the blackboard, which a team does not share",
    **dict.fromkeys(
        ("LoopInt", "LoopBool", "LoopDouble", "LoopString"),
        "it takes items from a queue on the blackboard, which a team does not share",
    ),
    **dict.fromkeys(
        SWITCHES, "it chooses by a value on the blackboard, which a team does not share"
    ),
}
# Controls that neither halt a child nor restart it before they have ended themselves.
_LEAVES_ALONE = frozenset({"Sequence", "AsyncSequence", "Fallback", "AsyncFallback", "IfThenElse"})
_NAME = re.compile(NAME_PATTERN)
_ARGUMENT = re.compile(ARGUMENT_PATTERN)
_MAX_COUNT = 1_000_000_000


@dataclass(frozen=True, slots=True)
class TeamTree:
    """The team's tree, or None and what cannot be carried out, with path, line and reason.

    `notes` are differences in a team's behavior.
    """

    spec: NodeSpec | None
    refusals: tuple[Problem, ...]
    notes: tuple[Problem, ...] = ()


def to_team_tree(library: Library, tree: str, unknown_leaves: Category | None = None) -> TeamTree:
    """Translate a tree with its SubTrees.

    A leaf without a model is refused, since it may be an action or a condition, unless
    `unknown_leaves` gives its category. Raises FileError if the tree cannot be expanded.
    """
    return translated(library, expand(library, tree), unknown_leaves)


def translated(
    library: Library, expanded: ExpandedTree, unknown_leaves: Category | None = None
) -> TeamTree:
    """Like `to_team_tree`, for an expanded tree; a node with a `call` is a task."""
    translation = _Translation(library, expanded, unknown_leaves)
    spec = translation.node(expanded.root)
    if not translation.refusals and spec is not None:
        try:
            build_tree(spec)
        except TreeError as error:
            root = expanded.root
            translation.refusals.append(Problem(root.file, root.line, "", str(error)))
    refusals = tuple(sorted(translation.refusals, key=lambda p: (p.file, p.line)))
    notes = tuple(sorted(translation.notes, key=lambda p: (p.file, p.line)))
    return TeamTree(None if refusals else spec, refusals, notes)


class _RefusedError(Exception):
    """A node cannot be carried out; the message gives the reason."""


class _Translation:
    def __init__(
        self,
        library: Library,
        tree: ExpandedTree,
        unknown_leaves: Category | None,
    ) -> None:
        self.library = library
        self.constants = tree.constants
        self.unknown_leaves = unknown_leaves
        self.refusals: list[Problem] = []
        self.notes: list[Problem] = []
        self.keepers = _keepers(tree.root)
        self.yielding: set[str] = set()
        self.written = access_below([tree.root], library).writes

    def refuse(self, node: ExpandedNode, reason: str) -> None:
        self.refusals.append(Problem(node.file, node.line, node.path, f"{node.type}: {reason}"))

    def note(self, node: ExpandedNode, text: str) -> None:
        self.notes.append(Problem(node.file, node.line, node.path, f"{node.type}: {text}"))

    def node(self, node: ExpandedNode) -> NodeSpec | None:
        """Return the node's spec, or None if it or a node below it has been refused."""
        if node.call:
            name = node.name if node.name not in (node.type, node.call) else ""
            return NodeSpec(Kind.ACTION, name=name, subject=node.call)
        self.refuse_conditions(node)
        children = [] if node.type in _REASONS else [self.node(child) for child in node.children]
        try:
            if node.type in ("AlwaysSuccess", "AlwaysFailure"):
                always = NodeSpec(Kind.CONDITION, subject=ALWAYS)
                is_success = node.type == "AlwaysSuccess"
                return always if is_success else NodeSpec(Kind.INVERTER, (always,))
            if node.type == "ScriptCondition":
                return self.formula(node)
            if node.category in LEAVES and node.type not in BUILTIN:
                return self.leaf(node)
            spec = self.inner(node)
        except _RefusedError as error:
            self.refuse(node, str(error))
            return None
        known = tuple(child for child in children if child is not None)
        if len(known) < len(children):
            return None
        return self.checked(node, replace(spec, children=known))

    def refuse_conditions(self, node: ExpandedNode) -> None:
        for name in node.conditions:
            if name in PRECONDITIONS:
                reason = "is not asked at every tick, or skips the node; use a Condition"
            else:
                reason = "changes the blackboard, which a team does not share"
            self.refuse(node, f"{name} {reason}")

    def inner(self, node: ExpandedNode) -> NodeSpec:
        """Return the spec of a control, decorator or SubTree, without its children."""
        if node.type == "Script":
            raise _RefusedError("a script with side effects: a team shares no blackboard")
        if node.type in _REASONS:
            raise _RefusedError(_REASONS[node.type])
        if node.category is Category.SUBTREE:
            if not node.children:
                raise _RefusedError(f"there is no tree {node.type!r}")
            return NodeSpec(Kind.SUBTREE, name=node.name)
        if node.type not in KINDS:
            raise _RefusedError(f"an unknown {node.category}; its effect is not known")
        kind, memory = KINDS[node.type]
        spec = NodeSpec(kind, name=node.name if node.name != node.type else "", memory=memory)
        match kind:
            case Kind.PARALLEL:
                return self.parallel(node, spec)
            case Kind.RETRY:
                return replace(spec, limit=self.count(node, "num_attempts", None))
            case Kind.REPEAT:
                return replace(spec, limit=self.count(node, "num_cycles", None))
            case Kind.TIMEOUT:
                return replace(spec, timeout_us=self.count(node, "msec", None) * 1000)
        return spec

    def count(self, node: ExpandedNode, port: str, default: int | None) -> int:
        """Return a number that is fixed in the file."""
        text = self.constant(node, port, node.ports.get(port, str(default)))
        try:
            value = int(text)
        except ValueError:
            raise _RefusedError(f"{port}={text!r} is not a whole number") from None
        if abs(value) > _MAX_COUNT:
            raise _RefusedError(f"{port}={value} is too large")
        return value

    def constant(self, node: ExpandedNode, port: str, value: str) -> str:
        """Return a port's value if it is fixed: a constant, or an entry that nobody writes."""
        key = pointer(value)
        if key is None:
            return value
        if key in self.constants:
            if key not in self.written:
                return self.constants[key]
            raise _RefusedError(
                f"port {port!r} has the constant {self.constants[key]!r}, but a node may write "
                f"{key!r}; describe nodes that only read it in <TreeNodesModel>, with input_port"
            )
        raise _RefusedError(
            f"port {port!r} uses the blackboard entry {key!r}, which a team does not share"
        )

    def parallel(self, node: ExpandedNode, spec: NodeSpec) -> NodeSpec:
        """Add a Parallel's thresholds. With the mark of our own export it has no memory."""
        count = len(node.children)
        needed = self.count(node, "success_count", -1)
        allowed = self.count(node, "failure_count", 1)
        needed = needed if needed >= 0 else count + needed + 1
        allowed = allowed if allowed >= 0 else count + allowed + 1
        if not 1 <= needed <= count:
            raise _RefusedError(f"it needs {needed} successes of {count} children")
        if not 1 <= allowed <= count:
            raise _RefusedError(f"it allows {allowed} failures of {count} children")
        is_early = allowed < count - needed + 1
        is_reactive = read_boolean(node.metadata.get(REACTIVE, "false")) or False
        return replace(
            spec,
            limit=needed,
            failures=allowed if is_early else 0,
            memory=Memory.NONE if is_reactive else spec.memory,
        )

    def checked(self, node: ExpandedNode, spec: NodeSpec) -> NodeSpec | None:
        """Check what depends on the children: SequenceWithMemory, and differences in a team."""
        if spec.memory is Memory.UNTIL_SUCCESS and node.path not in self.keepers:
            self.refuse(
                node,
                "it keeps its place when it is halted or begun anew; a team's does so only right "
                "below a RetryUntilSuccessful, with nothing above that halts or repeats it",
            )
            return None
        guards = node.children[:1] if spec.kind is Kind.IF_THEN_ELSE else node.children[:-1]
        yields = any(each.path in self.yielding for child in guards for each in child.walk())
        for text in notes(node.type, spec, yields):
            self.note(node, text)
        if returns_between_steps(node.type, spec):
            self.yielding.add(node.path)
        return spec

    def leaf(self, node: ExpandedNode) -> NodeSpec:
        """Translate an action or condition: its type and the values of its ports,
        `move(dock,fast)`.
        """
        category = node.category
        if node.is_guessed:
            if self.unknown_leaves is None:
                raise _RefusedError(
                    "an action or a condition? Describe it in <TreeNodesModel>, or write "
                    f"<Action ID={node.type!r}/> or <Condition ID={node.type!r}/>"
                )
            category = self.unknown_leaves
        model = self.library.model(node.type)
        values = dict(node.ports)
        for port in model.ports.values() if model else ():
            if port.direction is not Direction.INPUT and port.name in values:
                raise _RefusedError(
                    f"port {port.name!r} writes the blackboard, which a team does not share"
                )
            if port.default is not None:
                values.setdefault(port.name, port.default)
        order = {name: number for number, name in enumerate(model.ports if model else values)}
        arguments = [
            self.argument(node, name, values[name])
            for name in sorted(values, key=lambda name: order.get(name, len(order)))
        ]
        if not _NAME.fullmatch(node.type):
            raise _RefusedError("a task's name is made of letters, digits and '_'")
        if len(arguments) > MAX_ARGUMENTS:
            raise _RefusedError(f"more than {MAX_ARGUMENTS} ports")
        subject = f"{node.type}({','.join(arguments)})" if arguments else node.type
        kind = Kind.CONDITION if category is Category.CONDITION else Kind.ACTION
        name = node.name if node.name not in (node.type, subject) else ""
        return NodeSpec(kind, name=name, subject=subject)

    def argument(self, node: ExpandedNode, port: str, value: str) -> str:
        text = self.constant(node, port, value).strip()
        if not _ARGUMENT.fullmatch(text):
            raise _RefusedError(
                f"port {port!r} is {text[:40]!r}; an argument has 1 to 64 letters, digits, "
                "'_', '.', '+' or '-'"
            )
        return text

    def formula(self, node: ExpandedNode) -> NodeSpec:
        """Translate a script of conditions with `!`, `&&` and `||` to a tree of conditions."""
        try:
            script = parse(node.ports.get("code", ""))
        except ScriptError as error:
            raise _RefusedError(f"the script cannot be read: {error}") from None
        if script.written or len(script.statements) != 1:
            raise _RefusedError("a script with side effects: a team shares no blackboard")
        return self.condition(script.statements[0])

    def condition(self, expression: Expression) -> NodeSpec:
        if isinstance(expression, Name) and _NAME.fullmatch(expression.name):
            if expression.name in self.constants or expression.name in self.written:
                raise _RefusedError(
                    f"the blackboard entry {expression.name!r} is written in the tree; a team's "
                    "conditions are set by its robots"
                )
            return NodeSpec(Kind.CONDITION, subject=expression.name)
        if isinstance(expression, Unary) and expression.operator == "!":
            return NodeSpec(Kind.INVERTER, (self.condition(expression.operand),))
        if isinstance(expression, Binary) and expression.operator in ("&&", "||"):
            kind = Kind.SEQUENCE if expression.operator == "&&" else Kind.FALLBACK
            both = (self.condition(expression.left), self.condition(expression.right))
            return NodeSpec(kind, both)
        if isinstance(expression, Comparison) and len(expression.operators) == 1:
            left, right = expression.operands
            truth = _truth(right)
            if truth is not None and expression.operators[0] in ("==", "!="):
                inner = self.condition(left)
                is_same = truth is (expression.operators[0] == "==")
                return inner if is_same else NodeSpec(Kind.INVERTER, (inner,))
        raise _RefusedError(
            "a team's conditions are true or false: only !, &&, || and == true are possible"
        )


def _truth(expression: Expression) -> bool | None:
    if isinstance(expression, Boolean):
        return expression.value
    if isinstance(expression, Number) and expression.value in (0, 1):
        return bool(expression.value)
    return None


def _keepers(root: ExpandedNode) -> set[str]:
    """Return paths of SequenceWithMemory nodes that nothing halts and only a Retry restarts."""
    found: set[str] = set()
    waiting = [(root, True, False)]
    while waiting:
        node, is_free, is_retried = waiting.pop()
        if node.type == "SequenceWithMemory" and is_free:
            found.add(node.path)
        is_subtree = node.category is Category.SUBTREE
        goes_on = is_free and not is_retried
        if node.type == "RetryUntilSuccessful":
            waiting += [(child, goes_on, True) for child in node.children]
        elif is_subtree:
            waiting += [(child, is_free, is_retried) for child in node.children]
        else:
            goes_on = goes_on and node.type in _LEAVES_ALONE
            waiting += [(child, goes_on, False) for child in node.children]
    return found
