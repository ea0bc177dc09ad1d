"""Converts version 3 files: names and meanings that changed in version 4."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, SWITCHES
from mrbt_mesh.btcpp.files.document import (
    CONDITIONS,
    EXPLICIT_TAGS,
    LEAVES,
    SUBTREE,
    TREE,
    Direction,
    Document,
    NodeManifest,
    is_port,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Element
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.scripts.values import read_boolean

RENAMED_NODES = {
    "SequenceStar": "SequenceWithMemory",
    "FallbackStar": "Fallback",
    "RetryUntilSuccesful": "RetryUntilSuccessful",
    "SubTreePlus": SUBTREE,
}
RENAMED_PORTS = {
    "Parallel": {
        "success_threshold": "success_count",
        "failure_threshold": "failure_count",
        "threshold": "success_count",
    },
}
# By version 3 tag; each attribute has an effect only on that tag.
RENAMED_SUBTREE_ATTRIBUTES = {
    SUBTREE: {"__shared_blackboard": "_autoremap"},
    "SubTreePlus": {"__autoremap": "_autoremap"},
}
_SUBTREE_ATTRIBUTES = frozenset(old for each in RENAMED_SUBTREE_ATTRIBUTES.values() for old in each)
_CHECK = "<BlackboardCheck...> is gone; write <Precondition if='a == b' else='FAILURE'>"
# Groot 1 wrapped the root node in this tag; since 4.8.4 the name is reserved.
_GROOT_ROOT = "Root"

Note: TypeAlias = Callable[[str, bool], None]


# Nodes that only version 3 has, and nodes that only version 4 has.
_CHECKS = frozenset(f"BlackboardCheck{kind}" for kind in ("Int", "Double", "String", "Bool"))
_ONLY_3 = _CHECKS | RENAMED_NODES.keys()
_ONLY_4 = frozenset(BUILTIN) - {
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel", "IfThenElse"),
    *("WhileDoElse", *SWITCHES, "Inverter"),
    *("ForceSuccess", "ForceFailure", "RetryUntilSuccessful", "Repeat", "Timeout", "Delay"),
    *("KeepRunningUntilFailure", "AlwaysSuccess", "AlwaysFailure", "SetBlackboard", "Sleep"),
}
_PORTS_OF_4 = frozenset(RENAMED_PORTS["Parallel"].values())


def _version(document: Document) -> tuple[int, str]:
    """Return a file's version and, if it has no BTCPP_format, the reason for that version.

    Features that only one version has decide. Otherwise a constant passed to a SubTree means
    version 3, where it is the name of an entry, if the file uses an entry of that name.
    """
    given = document.root.attributes.get("BTCPP_format")
    if given is not None:
        return (3 if given.strip() == "3" else 4), ""
    marks = {3: "", 4: ""}
    for tree in document.trees:
        for element in tree.walk():
            for version, mark in _marks(element):
                marks[version] = marks[version] or f"{mark} in line {element.line}"
    if marks[3] or marks[4]:
        version = 3 if marks[3] else 4
        return version, f"because of {marks[version]}"
    if mark := _entry_of_subtree(document):
        return 3, f"because of {mark}"
    return 4, "as nothing in it is of version 3"


def _marks(element: Element) -> Iterator[tuple[int, str]]:
    """Yield (version, mark) for each feature of a node that only one version has."""
    name = type_id(element)
    if name in _ONLY_3 or element.tag in _ONLY_3:
        yield 3, name if name in _ONLY_3 else element.tag
    elif name in _ONLY_4:
        yield 4, name
    is_subtree = element.tag == SUBTREE
    of_3 = _SUBTREE_ATTRIBUTES if is_subtree else RENAMED_PORTS.get(name, {})
    of_4 = {*CONDITIONS, "_autoremap", *(_PORTS_OF_4 if name == "Parallel" else ())}
    for attribute, value in element.attributes.items():
        if attribute in of_3:
            yield 3, attribute
        elif is_port(attribute) and old_pointer(value):
            yield 3, f"{attribute}={value!r}"
        elif attribute in of_4:
            yield 4, attribute
        elif is_subtree and is_port(attribute) and pointer(value, attribute):
            yield 4, f"{attribute}={value!r}"


def _entry_of_subtree(document: Document) -> str:
    """Return a constant passed to a SubTree that names an entry of the surrounding tree, or ""."""
    for tree in document.trees:
        elements = list(tree.walk())
        entries = {pointer(v, n) for e in elements for n, v in ports(e).items()}
        entries |= {e.get("output_key") for e in elements if type_id(e) == "SetBlackboard"}
        entries |= set(ports(tree))
        for element in elements:
            for attribute, value in ports(element).items() if element.tag == SUBTREE else ():
                if value in entries:
                    return f"{attribute}={value!r} in line {element.line}"
    return ""


def upgrade(document: Document, findings: Findings) -> Document:
    """Convert a document to version 4; changes are added to `findings`.

    A change of something that BehaviorTree.CPP 4 refuses is added as a broken rule. A document of
    version 4 is returned unchanged, or with `BTCPP_format` added if it is missing.
    """
    version, reason = _version(document)
    if reason:
        root = document.root
        message = f"BTCPP_format is missing; read as version {version}, {reason}"
        findings.warn(document.file, root.line, "root", message)
    elif version == 4:
        return document
    upgraded = document.copy()
    root = upgraded.root
    root.attributes = {"BTCPP_format": "4"} | root.attributes | {"BTCPP_format": "4"}
    if version == 3:
        _upgrade_root(upgraded, findings)
    return upgraded


def _upgrade_root(document: Document, findings: Findings) -> None:
    def note_at(element: Element) -> Note:
        line = element.line
        place = f"{element.tag} {element.get('name') or element.get('ID')}".strip()

        def note(message: str, refused: bool) -> None:
            add = findings.rule if refused else findings.warn
            add(document.file, line, place, f"version 3: {message}")

        return note

    models = document.models()
    trees = _first_of_each_name(document, note_at)
    for part in document.root.children:
        if part.tag == TREE:
            _without_groot_root(part, note_at)
        for element in part.walk():
            note = note_at(element)
            is_node = part.tag == TREE and element is not part
            if is_node and element.tag in LEAVES and element.get("ID") in trees - models.keys():
                note(f"{element.get('ID')!r} is a tree: a <{SUBTREE}>", True)
                element.tag = SUBTREE
            _upgrade_element(element, part.tag == TREE, note)
            if is_node and element.tag != SUBTREE and type_id(element) in models:
                _upgrade_outputs(element, models[type_id(element)], note)


def _first_of_each_name(document: Document, note_at: Callable[[Element], Note]) -> set[str]:
    """Keep only the first tree of each ID, which version 3 uses. Returns the IDs."""
    found: set[str] = set()
    for tree in document.trees:
        name = tree.get("ID")
        if name and name in found:
            note_at(tree)(
                f"there is a tree {name!r} already, which counts; this one is gone", False
            )
            document.root.content = [each for each in document.root.content if each is not tree]
        found.add(name)
    return found - {""}


def _without_groot_root(tree: Element, note_at: Callable[[Element], Note]) -> None:
    for node in tree.children:
        if node.tag == _GROOT_ROOT and len(node.children) == 1:
            note_at(node)(f"<{_GROOT_ROOT}> of Groot 1 is left out", True)
            place = next(n for n, each in enumerate(tree.content) if each is node)
            tree.content[place : place + 1] = node.content


def old_pointer(value: str) -> str:
    """Return the entry that a version 3 value `${entry}` names, else ""."""
    return value[2:-1] if len(value) > 3 and value.startswith("${") and value[-1] == "}" else ""


def _upgrade_element(element: Element, in_tree: bool, note: Note) -> None:
    old_tag, name = element.tag, type_id(element)
    if new := RENAMED_NODES.get(element.tag):
        note(f"<{element.tag}> is <{new}> now{_kept(new)}", in_tree)
        element.tag = new
    elif element.tag in EXPLICIT_TAGS and (new := RENAMED_NODES.get(name)):
        note(f"ID {name!r} is {new!r} now{_kept(new)}", in_tree)
        element.attributes["ID"] = new
    elif in_tree and name in _CHECKS:
        note(_CHECK, True)
    if element.tag == SUBTREE:
        _upgrade_subtree(element, old_tag, in_tree, note)
        return
    renamed = RENAMED_PORTS.get(name, {})
    attributes: dict[str, str] = {}
    for old, value in element.attributes.items():
        attribute = renamed.get(old, old)
        if attribute != old:
            note(f"attribute {old!r} is {attribute!r} now", in_tree and is_port(old))
        attributes[attribute] = _new_pointer(attribute, value, note) if in_tree else value
    element.attributes = attributes


def _kept(name: str) -> str:
    is_kept = name == "SequenceWithMemory"
    return ", which keeps its place when it is halted, too" if is_kept else ""


def _new_pointer(attribute: str, value: str, note: Note) -> str:
    entry = old_pointer(value) if is_port(attribute) else ""
    if not entry:
        return value
    note(f"{attribute}={value!r} is '{{{entry}}}' now", False)
    return f"{{{entry}}}"


def _upgrade_subtree(element: Element, old_tag: str, in_tree: bool, note: Note) -> None:
    """Convert the attributes of a SubTree.

    A version 3 <SubTree> names entries by plain text, a <SubTreePlus> in braces as in version 4.
    """
    renamed = RENAMED_SUBTREE_ATTRIBUTES.get(old_tag, RENAMED_SUBTREE_ATTRIBUTES[SUBTREE])
    is_plus = old_tag == "SubTreePlus"
    is_shared = not is_plus and bool(read_boolean(element.get("__shared_blackboard")))
    attributes: dict[str, str] = {}
    for old, value in element.attributes.items():
        if in_tree and old in _SUBTREE_ATTRIBUTES and old not in renamed:
            note(f"attribute {old!r} has no effect on <{old_tag}>; it is left out", False)
        elif in_tree and is_shared and is_port(old):
            note(f"{old}={value!r} has no effect beside __shared_blackboard; it is left out", False)
        else:
            attribute = renamed.get(old, old)
            if attribute != old:
                note(f"attribute {old!r} is {attribute!r} now", False)
            new = _new_pointer(attribute, value, note) if in_tree else value
            if in_tree and not is_plus and is_port(attribute) and pointer(new, attribute) is None:
                note(f"{attribute}={value!r} names a blackboard entry: '{{{value}}}' now", False)
                new = f"{{{value}}}"
            attributes[attribute] = new
    element.attributes = attributes


def _upgrade_outputs(element: Element, model: NodeManifest, note: Note) -> None:
    """Put braces around the plain entry names of output ports, as version 4 requires."""
    for name, value in ports(element).items():
        port = model.ports.get(name)
        is_output = port is not None and port.direction is Direction.OUTPUT
        if is_output and value.strip() not in ("", "=") and pointer(value, name) is None:
            note(f"{name}={value!r} names the entry that is written: '{{{value}}}' now", False)
            element.attributes[name] = f"{{{value}}}"
