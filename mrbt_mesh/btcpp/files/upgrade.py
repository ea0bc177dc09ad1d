"""Version 3 files: what was renamed or means something else in version 4."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, SWITCHES
from mrbt_mesh.btcpp.files.document import (
    CONDITIONS,
    EXPLICIT_TAGS,
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

RENAMED_NODES = {
    "SequenceStar": "SequenceWithMemory",
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
RENAMED_SUBTREE_ATTRIBUTES = {"__shared_blackboard": "_autoremap", "__autoremap": "_autoremap"}


# Nodes of version 3 that version 4 has no longer, and of version 4 that version 3 did not have.
_ONLY_3 = frozenset({*RENAMED_NODES, "FallbackStar", "BlackboardCheckInt", "BlackboardCheckDouble"})
_ONLY_3 |= {"BlackboardCheckString", "BlackboardCheckBool"}
_ONLY_4 = frozenset(BUILTIN) - {
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Parallel", "IfThenElse"),
    *("WhileDoElse", *SWITCHES, "Inverter"),
    *("ForceSuccess", "ForceFailure", "RetryUntilSuccessful", "Repeat", "Timeout", "Delay"),
    *("KeepRunningUntilFailure", "AlwaysSuccess", "AlwaysFailure", "SetBlackboard", "Sleep"),
}
_PORTS_OF_4 = frozenset(RENAMED_PORTS["Parallel"].values())


def _version(document: Document) -> tuple[int, str]:
    """The version of a file, and how it is known without BTCPP_format.

    What only one version has decides; else constants that a SubTree is given, which in version 3
    are the names of entries: they are, if the file uses such an entry.
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
    """What at a node only one of the two versions has."""
    name = type_id(element)
    if name in _ONLY_3 or element.tag in _ONLY_3:
        yield 3, name if name in _ONLY_3 else element.tag
    elif name in _ONLY_4:
        yield 4, name
    is_subtree = element.tag == SUBTREE
    of_3 = RENAMED_SUBTREE_ATTRIBUTES if is_subtree else RENAMED_PORTS.get(name, {})
    of_4 = {*CONDITIONS, "_autoremap", *(_PORTS_OF_4 if name == "Parallel" else ())}
    for attribute, value in element.attributes.items():
        if attribute in of_3:
            yield 3, attribute
        elif attribute in of_4:
            yield 4, attribute
        elif is_subtree and is_port(attribute) and pointer(value, attribute):
            yield 4, f"{attribute}={value!r}"


def _entry_of_subtree(document: Document) -> str:
    """A constant that a SubTree is given and that names an entry of the tree around it."""
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
    """The document in version 4; what was changed is noted in `findings`.

    BehaviorTree.CPP 4 refuses some of what is changed, so that is a broken rule. A document of
    version 4 comes back as it is, or with `BTCPP_format` if it has none.
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
    models = document.models()
    for part in root.children if version == 3 else ():
        for element in part.walk():
            place = f"{element.tag} {element.get('name') or element.get('ID')}".strip()

            def note(
                message: str, refused: bool, line: int = element.line, place: str = place
            ) -> None:
                add = findings.rule if refused else findings.warn
                add(document.file, line, place, f"version 3: {message}")

            _upgrade_element(element, part.tag == TREE, note)
            if part.tag == TREE and element.tag != SUBTREE and type_id(element) in models:
                _upgrade_outputs(element, models[type_id(element)], note)
    return upgraded


def _upgrade_element(element: Element, in_tree: bool, note: Callable[[str, bool], None]) -> None:
    was_plain_subtree = in_tree and element.tag == SUBTREE
    name = type_id(element)
    if new := RENAMED_NODES.get(element.tag):
        note(f"<{element.tag}> is <{new}> now", in_tree)
        element.tag = new
    elif element.tag in EXPLICIT_TAGS and (new := RENAMED_NODES.get(name)):
        note(f"ID {name!r} is {new!r} now", in_tree)
        element.attributes["ID"] = new
    renamed = RENAMED_PORTS.get(name, {})
    if element.tag == SUBTREE:
        renamed = RENAMED_SUBTREE_ATTRIBUTES
    attributes: dict[str, str] = {}
    for old, value in element.attributes.items():
        attribute = renamed.get(old, old)
        if attribute != old:
            note(f"attribute {old!r} is {attribute!r} now", in_tree and is_port(old))
        if was_plain_subtree and is_port(attribute) and pointer(value, attribute) is None:
            note(f"{attribute}={value!r} names a blackboard entry: '{{{value}}}' now", False)
            value = f"{{{value}}}"
        attributes[attribute] = value
    element.attributes = attributes


def _upgrade_outputs(
    element: Element, model: NodeManifest, note: Callable[[str, bool], None]
) -> None:
    """A bare name at an output port was the entry to write; version 4 finds nothing to write."""
    for name, value in ports(element).items():
        port = model.ports.get(name)
        is_output = port is not None and port.direction is Direction.OUTPUT
        if is_output and value.strip() not in ("", "=") and pointer(value, name) is None:
            note(f"{name}={value!r} names the entry that is written: '{{{value}}}' now", False)
            element.attributes[name] = f"{{{value}}}"
