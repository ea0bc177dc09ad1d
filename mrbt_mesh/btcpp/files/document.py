"""A BehaviorTree.CPP file: its trees, includes and models, and the meaning of node attributes.

A document keeps the XML itself, so nothing of the file is lost.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mrbt_mesh.btcpp.files.elements import Content, Element, write_content
from mrbt_mesh.btcpp.files.xml_reader import MAX_BYTES, XmlContent, parse_xml, read_xml
from mrbt_mesh.errors import FileError, Problem

PRECONDITIONS = ("_failureIf", "_successIf", "_skipIf", "_while")
POSTCONDITIONS = ("_onSuccess", "_onFailure", "_onHalted", "_post")
CONDITIONS = PRECONDITIONS + POSTCONDITIONS
TREE, MODELS, INCLUDE, SUBTREE = "BehaviorTree", "TreeNodesModel", "include", "SubTree"


class Category(enum.StrEnum):
    """The kinds of nodes, named like the tags of the explicit form."""

    ACTION = "Action"
    CONDITION = "Condition"
    CONTROL = "Control"
    DECORATOR = "Decorator"
    SUBTREE = "SubTree"


class Direction(enum.StrEnum):
    """Whether a node reads or writes a port; named like the tags of a model."""

    INPUT = "input_port"
    OUTPUT = "output_port"
    INOUT = "inout_port"


EXPLICIT_TAGS = frozenset(Category)
LEAVES = frozenset({Category.ACTION, Category.CONDITION})


@dataclass(frozen=True, slots=True)
class Port:
    """One port of a model. `default` is None if the port has none."""

    name: str
    direction: Direction = Direction.INPUT
    type: str = ""
    default: str | None = None
    description: str = ""


@dataclass(frozen=True, slots=True)
class NodeManifest:
    """A registered node: built in, or listed in <TreeNodesModel>."""

    id: str
    category: Category
    ports: Mapping[str, Port] = field(default_factory=dict)
    description: str = ""
    line: int = 0


def type_id(element: Element) -> str:
    """Return a node's type: `ID` in the explicit form, else the tag; empty if `ID` is missing."""
    return element.get("ID") if element.tag in EXPLICIT_TAGS else element.tag


def instance_name(element: Element) -> str:
    """Return a node's own name: `name`, else its type."""
    return element.get("name") or type_id(element)


def is_port(attribute: str) -> bool:
    """Return whether an attribute of a node is a port."""
    return attribute[:1].isalpha() and attribute not in ("name", "ID")


def ports(element: Element) -> dict[str, str]:
    """Return a node's ports with their values, in file order."""
    return {name: value for name, value in element.attributes.items() if is_port(name)}


def conditions(element: Element) -> dict[str, str]:
    """Return a node's pre- and post-conditions, in the order of evaluation."""
    return {name: element.attributes[name] for name in CONDITIONS if name in element.attributes}


def metadata(element: Element) -> dict[str, str]:
    """Return a node's other attributes, for example Groot2's `_collapsed`."""
    known = ("name", "ID", "_autoremap", *CONDITIONS)
    return {
        name: value
        for name, value in element.attributes.items()
        if not is_port(name) and name not in known
    }


def pointer(value: str, attribute: str = "") -> str | None:
    """Return the blackboard key that a port's value names; None for a constant.

    `{=}` and `=` mean the key with the name of the attribute.
    """
    trimmed = value.strip()
    if trimmed in ("{=}", "=") and attribute:
        return attribute
    if len(trimmed) >= 3 and trimmed[0] == "{" and trimmed[-1] == "}":
        return trimmed[1:-1]
    return None


@dataclass(slots=True)
class Document:
    """One file. `items` are the root element and the comments and instructions around it.

    `tolerated`: invalid XML that BehaviorTree.CPP reads. `refused`: valid XML that it refuses.
    """

    file: str
    items: list[Content]
    tolerated: tuple[Problem, ...] = field(default=(), compare=False)
    refused: tuple[Problem, ...] = field(default=(), compare=False)

    @property
    def root(self) -> Element:
        """The root element."""
        return next(item for item in self.items if isinstance(item, Element))

    def _of(self, tag: str) -> list[Element]:
        return [element for element in self.root.children if element.tag == tag]

    @property
    def trees(self) -> list[Element]:
        """The <BehaviorTree> elements, in order."""
        return self._of(TREE)

    @property
    def includes(self) -> list[Element]:
        """The <include> elements, in order."""
        return self._of(INCLUDE)

    @property
    def model_lists(self) -> list[Element]:
        """The <TreeNodesModel> elements, of which there should be at most one."""
        return self._of(MODELS)

    @property
    def main_tree(self) -> str:
        """`main_tree_to_execute`, empty if it is not given."""
        return self.root.get("main_tree_to_execute")

    def models(self) -> dict[str, NodeManifest]:
        """Return the node models of the file by ID; if an ID occurs twice, the first model."""
        found: dict[str, NodeManifest] = {}
        for element in (model for models in self.model_lists for model in models.children):
            if element.tag in EXPLICIT_TAGS and element.get("ID"):
                found.setdefault(element.get("ID"), _model(element))
        return found

    def text(self) -> str:
        """Return the document as XML; reading it again gives an equal document."""
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', *map(write_content, self.items)]
        return "\n".join(lines) + "\n"

    def copy(self) -> Document:
        """Return a copy that shares no mutable data."""
        items = [item.copy() if isinstance(item, Element) else item for item in self.items]
        return Document(self.file, items, self.tolerated, self.refused)


def _model(element: Element) -> NodeManifest:
    found = {}
    description = element.get("description")
    for child in element.children:
        if child.tag in frozenset(Direction) and child.get("name"):
            found[child.get("name")] = Port(
                child.get("name"),
                Direction(child.tag),
                child.get("type"),
                child.attributes.get("default"),
                child.text.strip() or child.get("description"),
            )
        elif child.tag == "description":
            description = child.text.strip()
    return NodeManifest(element.get("ID"), Category(element.tag), found, description, element.line)


def read_document(path: Path, limit_bytes: int = MAX_BYTES) -> Document:
    """Read a BehaviorTree.CPP file. Raises FileError, and nothing else."""
    return _document(str(path), read_xml(path, limit_bytes))


def parse_document(content: bytes | str, file: str) -> Document:
    """Like `read_document`, from memory; `file` is used in messages."""
    return _document(file, parse_xml(content, file))


def _document(file: str, found: XmlContent) -> Document:
    document = Document(file, found.items, tuple(found.tolerated), tuple(found.refused))
    root = document.root
    if root.tag != "root":
        message = f"the first element must be <root>, this is <{root.tag}>"
        if root.tag.lower() == "root":
            message += "; write it in small letters"
        elif root.tag.startswith("py_trees"):
            message += ", of py_trees; only trees of BehaviorTree.CPP are read"
        raise FileError([Problem(file, root.line, root.tag, message)])
    return document
