"""Checks the nodes of one tree: form, children, ports, conditions, references."""

from __future__ import annotations

from dataclasses import dataclass

from mrbt_mesh.btcpp.files.builtin_nodes import (
    BUILTIN,
    LOOP_ITEMS,
    NAV2_NODES,
    SWITCHES,
    category_of,
    children_allowed,
)
from mrbt_mesh.btcpp.files.check_values import (
    conversion_problem,
    hint,
    is_constant,
    name_problem,
    running_problem,
    script_problem,
    typing_problem,
    value_problem,
)
from mrbt_mesh.btcpp.files.document import (
    CONDITIONS,
    EXPLICIT_TAGS,
    LEAVES,
    SUBTREE,
    Category,
    Direction,
    Port,
    conditions,
    instance_name,
    metadata,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library
from mrbt_mesh.btcpp.files.upgrade import old_pointer
from mrbt_mesh.btcpp.scripts.cpp_types import canonical_type
from mrbt_mesh.btcpp.scripts.parser import dialect_problem
from mrbt_mesh.btcpp.scripts.values import read_boolean
from mrbt_mesh.errors import MAX_PATH_CHARACTERS

# Ports that a built-in node needs to be ticked.
REQUIRED = {
    "RetryUntilSuccessful": ("num_attempts",),
    "Repeat": ("num_cycles",),
    "Timeout": ("msec",),
    "Delay": ("delay_msec",),
    "Sleep": ("msec",),
    "Precondition": ("if",),
    "Script": ("code",),
    "ScriptCondition": ("code",),
    "SetBlackboard": ("value", "output_key"),
    "UnsetBlackboard": ("key",),
    "SkipUnlessUpdated": ("entry",),
    "WaitValueUpdate": ("entry",),
    "WasEntryUpdated": ("entry",),
    **dict.fromkeys(("LoopInt", "LoopBool", "LoopDouble", "LoopString"), ("queue",)),
    "PersistentSequence": ("current_child_idx",),
}
_THRESHOLDS = ("success_count", "failure_count", "max_failures")
_LOWER_CONDITIONS = {name.lower(): name for name in CONDITIONS}


@dataclass(frozen=True, slots=True)
class _Place:
    """A node being checked: its element, type, category and path."""

    element: Element
    name: str
    category: Category
    path: str


class NodeChecker:
    """Checks the nodes below a <BehaviorTree>; one per tree."""

    def __init__(self, library: Library, file: str, findings: Findings) -> None:
        self.library = library
        self.file = file
        self.findings = findings
        self.subtree_names: dict[str, int] = {}
        # Bad names that were reported already.
        self.odd_names: set[str] = set()
        self.missing_trees: set[str] = set()

    def check(self, top: Element, path: str) -> None:
        """Check a node and all its descendants; `path` is the path of its parent."""
        waiting = [(top, path)]
        while waiting:
            element, above = waiting.pop()
            here = child_path(above, element)
            self.check_node(element, here)
            waiting.extend((child, here) for child in reversed(element.children))

    def error(self, place: _Place, message: str) -> None:
        self.findings.error(self.file, place.element.line, place.path, message)

    def rule(self, place: _Place, message: str) -> None:
        self.findings.rule(self.file, place.element.line, place.path, message)

    def warn(self, place: _Place, message: str) -> None:
        self.findings.warn(self.file, place.element.line, place.path, message)

    def check_node(self, element: Element, path: str) -> None:
        name = type_id(element)
        models = self.library.models
        category = category_of(name, element.tag, models, len(element.children))
        place = _Place(element, name, category, path)
        self.check_form(place)
        self.check_children(place)
        self.check_attributes(place)
        if category is Category.SUBTREE:
            self.check_subtree(place)
            return
        self.check_ports(place)
        if name in ("Parallel", "ParallelAll"):
            self.check_thresholds(place)

    def check_form(self, place: _Place) -> None:
        element, name = place.element, place.name
        model = self.library.model(name)
        if element.tag in EXPLICIT_TAGS:
            if not name:
                self.error(place, f"<{element.tag}> needs an ID")
            elif place.category != element.tag:
                self.warn(place, f"{name!r} is a <{place.category}>, not <{element.tag}>")
        else:
            if "ID" in element.attributes:
                self.rule(place, f"<{name}> takes no ID; it is for <Action ID=...> and its like")
            if model is None:
                message = f"node {name!r} is neither built in nor in <TreeNodesModel>"
                if self.findings.is_strict:
                    self.rule(place, message + hint(name, [*BUILTIN, *self.library.models]))
                elif name in self.library.trees:
                    self.warn(place, f"{message}; to use the tree, write <SubTree ID={name!r}/>")
        if name not in self.odd_names and (problem := name_problem(name)):
            self.odd_names.add(name)
            self.rule(place, problem)
        if "\x7f" in element.get("name"):
            self.rule(place, "the attribute 'name' contains a control character")

    def check_children(self, place: _Place) -> None:
        count = len(place.element.children)
        fewest, most = children_allowed(place.name, place.category)
        what = place.name or place.element.tag
        if place.category is Category.SUBTREE and count:
            self.error(place, f"<{SUBTREE}> takes no children, it has {count}")
        elif place.category in LEAVES and count:
            self.error(place, f"{what} takes no children (<{place.category}>), it has {count}")
        elif count < fewest or (most is not None and count > most):
            if most is None:
                needs = f"at least {fewest} child" + ("ren" if fewest > 1 else "")
            elif fewest == most:
                needs = f"exactly {fewest} child" + ("ren" if fewest > 1 else "")
            else:
                needs = f"{fewest} to {most} children"
            self.error(place, f"{what} needs {needs}, it has {count}")
        if place.element.text:
            self.warn(place, "text inside a node means nothing; it is kept")
        if place.name == "ReactiveSequence":
            self.check_reactive(place)

    def check_reactive(self, place: _Place) -> None:
        """Check the children of a ReactiveSequence.

        BehaviorTree.CPP looks them up by their tags here, so it finds no node for <Action ID=...>.
        """
        for child in place.element.children:
            if child.tag in EXPLICIT_TAGS and child.tag != SUBTREE:
                name = type_id(child)
                message = f"below ReactiveSequence <{child.tag} ID={name!r}> cannot be loaded"
                self.rule(place, f"{message}; write <{name}/>, or use mrbt tree convert")
        asynchronous = [c for c in place.element.children if c.tag == "AsyncSequence"]
        if len(asynchronous) > 1:
            self.rule(place, "ReactiveSequence takes at most one AsyncSequence as its child")

    def check_attributes(self, place: _Place) -> None:
        for name, script in conditions(place.element).items():
            if problem := script_problem(script):
                self.error(place, f"{name}: {problem}")
            elif problem := dialect_problem(script) or running_problem(script):
                self.rule(place, f"{name}: {problem}")
        for name, value in ports(place.element).items():
            if entry := old_pointer(value):
                message = (
                    f"port {name!r}: '${{{entry}}}' is a text; for the entry write '{{{entry}}}'"
                )
                self.warn(place, message)
        for name in metadata(place.element):
            if meant := _LOWER_CONDITIONS.get(name.lower()):
                self.warn(place, f"{name!r} has no effect; did you mean {meant!r}?")
            elif not name.startswith("_"):
                self.warn(place, f"attribute {name!r} has no effect; ports begin with a letter")

    def check_ports(self, place: _Place) -> None:
        model = self.library.model(place.name)
        if model is None:
            return
        given = ports(place.element)
        is_builtin = model in (BUILTIN.get(place.name), NAV2_NODES.get(place.name))
        for name, value in given.items():
            port = model.ports.get(name)
            if port is None:
                self.rule(place, f"{place.name} has no port {name!r}{hint(name, model.ports)}")
            elif is_builtin:
                self.check_value(place, port, value)
            else:
                self.check_model_value(place, port, value)
        for name in REQUIRED.get(place.name, ()):
            if name not in given:
                self.rule(place, f"{place.name} needs the port {name!r}")
            elif name == "entry" and not given[name]:
                self.rule(place, f"{place.name} needs an entry")
        if place.name in SWITCHES and "variable" not in given:
            self.warn(place, f"{place.name} without 'variable' always chooses its last child")
        if place.name in LOOP_ITEMS and is_constant(given.get("value", ""), "value"):
            self.warn(place, f'{place.name} needs an entry for its items: value="{{name}}"')
        if not is_builtin:
            left_out = [port for port in model.ports.values() if port.name not in given]
            self.check_defaults(place, left_out)

    def check_defaults(self, place: _Place, left_out: list[Port]) -> None:
        """Check the defaults of omitted ports, with warnings only.

        Defaults in models are often C++ code; BehaviorTree.CPP uses only those of the program.
        """
        for port in left_out:
            text = port.default or ""
            if not text or pointer(text, port.name) is not None:
                continue
            if problem := conversion_problem(canonical_type(port.type), text):
                self.warn(place, f"port {port.name!r}: the default {problem}")

    def check_value(self, place: _Place, port: Port, value: str) -> None:
        """Check the value of a built-in node's port. A Loop's `value` has the type of its items."""
        kind = port.type
        if place.name in LOOP_ITEMS and port.name == "value":
            kind = LOOP_ITEMS[place.name]
            if is_constant(value, port.name) and (problem := value_problem("", kind, value)):
                self.rule(place, f"port 'value': {problem}")
                return
        if is_constant(value, port.name) and (problem := value_problem(place.name, kind, value)):
            self.error(place, f"port {port.name!r}: {problem}")
            return
        if place.name == "LoopString":
            if value.startswith("json:"):
                self.warn(place, "port 'queue': BehaviorTree.CPP takes JSON for a single text")
            return
        problem, is_refused = typing_problem(kind, value)
        if problem:
            note = self.rule if is_refused else self.warn
            note(place, f"port {port.name!r}: {problem}")

    def check_model_value(self, place: _Place, port: Port, value: str) -> None:
        """Check the value of a port that a model describes."""
        if pointer(value, port.name) is None and port.direction is not Direction.INPUT:
            self.warn(place, f"port {port.name!r} is written; it needs an entry: {{{port.name}}}")
        if value[:1] == "{" and value[-1:] == "}" and len(value) > 2:
            return
        if problem := conversion_problem(canonical_type(port.type), value):
            self.rule(place, f"port {port.name!r}: {problem}")

    def check_thresholds(self, place: _Place) -> None:
        count = len(place.element.children)
        for name in _THRESHOLDS:
            value = place.element.get(name).strip()
            if value.lstrip("+").isdecimal() and len(value) < 19 and int(value) > count:
                self.rule(place, f"{name}={value} is above the number of children, {count}")

    def check_subtree(self, place: _Place) -> None:
        element, name = place.element, place.name
        autoremap = element.get("_autoremap", "false")
        if read_boolean(autoremap) is None:
            self.error(place, f"_autoremap={autoremap!r} is not a boolean; write true or false")
        if name and name not in self.library.trees and name not in self.missing_trees:
            self.missing_trees.add(name)
            missing = self.library.missing_files
            where = f"; it may be in {', '.join(missing)}, which was not read" if missing else ""
            known = where or hint(name, self.library.trees)
            self.rule(place, f"there is no tree {name!r}{known}")
        for port in self.library.subtree_ports(element)[2]:
            self.rule(place, f"port {port!r} of tree {name!r} has to be given")
        own_name = element.get("name")
        if own_name in self.subtree_names:
            line = self.subtree_names[own_name]
            self.rule(place, f"a <{SUBTREE}> is called {own_name!r} already, in line {line}")
        elif own_name:
            self.subtree_names[own_name] = element.line


def child_path(above: str, element: Element) -> str:
    """Return the path of a node below `above`, for messages; a long path is cut in the middle."""
    path = f"{above}/{instance_name(element) or element.tag}"
    if len(path) > MAX_PATH_CHARACTERS:
        half = MAX_PATH_CHARACTERS // 2
        path = f"{path[:half]}...{path[-half:]}"
    return path
