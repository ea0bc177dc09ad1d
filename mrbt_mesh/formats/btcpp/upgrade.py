"""Version 3 files: what was renamed or means something else in version 4."""

from __future__ import annotations

from collections.abc import Callable

from mrbt_mesh.formats.btcpp.document import (
    EXPLICIT_TAGS,
    SUBTREE,
    TREE,
    Document,
    is_port,
    pointer,
    type_id,
)
from mrbt_mesh.formats.btcpp.elements import Element
from mrbt_mesh.formats.problems import Problem

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


def is_version_3(document: Document) -> bool:
    """Whether a file is read as one of version 3: it says so, or says nothing."""
    return document.root.get("BTCPP_format", "3").strip() == "3"


def upgrade(document: Document) -> tuple[Document, list[Problem]]:
    """The document in version 4, and a note for each change but the root's version.

    A document of version 4 comes back as it is.
    """
    if not is_version_3(document):
        return document, []
    upgraded = document.copy()
    notes: list[Problem] = []
    root = upgraded.root
    root.attributes = {"BTCPP_format": "4"} | root.attributes | {"BTCPP_format": "4"}
    for part in root.children:
        for element in part.walk():

            def note(message: str, element: Element = element) -> None:
                place = f"{element.tag} {element.get('name') or element.get('ID')}".strip()
                notes.append(Problem(document.file, element.line, place, f"version 3: {message}"))

            _upgrade_element(element, part.tag == TREE, note)
    return upgraded, notes


def _upgrade_element(element: Element, in_tree: bool, note: Callable[[str], None]) -> None:
    was_plain_subtree = in_tree and element.tag == SUBTREE
    name = type_id(element)
    if new := RENAMED_NODES.get(element.tag):
        note(f"<{element.tag}> is <{new}> now")
        element.tag = new
    elif element.tag in EXPLICIT_TAGS and (new := RENAMED_NODES.get(name)):
        note(f"ID {name!r} is {new!r} now")
        element.attributes["ID"] = new
    renamed = RENAMED_PORTS.get(name, {})
    if element.tag == SUBTREE:
        renamed = RENAMED_SUBTREE_ATTRIBUTES
    attributes: dict[str, str] = {}
    for old, value in element.attributes.items():
        attribute = renamed.get(old, old)
        if attribute != old:
            note(f"attribute {old!r} is {attribute!r} now")
        if was_plain_subtree and is_port(attribute) and pointer(value, attribute) is None:
            note(f"{attribute}={value!r} names a blackboard entry: '{{{value}}}' now")
            value = f"{{{value}}}"
        attributes[attribute] = value
    element.attributes = attributes
