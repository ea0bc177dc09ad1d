"""Writes trees so that Groot2 can open them: in the explicit form, with models of all nodes."""

from __future__ import annotations

from collections.abc import Iterator

from mrbt_mesh.btcpp.files.builtin_nodes import BUILTIN, category_of
from mrbt_mesh.btcpp.files.document import (
    EXPLICIT_TAGS,
    INCLUDE,
    MODELS,
    SUBTREE,
    TREE,
    Document,
    NodeManifest,
    instance_name,
    pointer,
    ports,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Content, Element, Text
from mrbt_mesh.btcpp.files.expand import expand
from mrbt_mesh.btcpp.files.library import Library, TreeSource


def explicit(library: Library, *, is_merged: bool = False) -> Document:
    """Return the first document in the explicit form, with models of all nodes that it uses.

    No models are added for a lone tree without an ID: next to models, BehaviorTree.CPP would
    require an ID. With `is_merged`, the trees of all included files replace the <include> elements.
    """
    document = library.documents[0].copy()
    if is_merged:
        _merge(document, library)
    for tree in document.trees:
        for element in tree.walk():
            if element is not tree:
                _make_explicit(element, library)
    if all(tree.get("ID") for tree in document.trees):
        _add_models(document, library)
    return document


def _make_explicit(element: Element, library: Library) -> None:
    name = type_id(element)
    category = category_of(name, element.tag, library.models, len(element.children))
    if element.tag in EXPLICIT_TAGS:
        element.tag = category
        return
    element.tag = category
    kept = {key: value for key, value in element.attributes.items() if key != "ID"}
    element.attributes = {"ID": name} | kept


def _merge(document: Document, library: Library) -> None:
    root = document.root
    if library.main_tree is not None and len(library.own_trees) > 1:
        root.attributes["main_tree_to_execute"] = library.main_tree
    here = {tree.get("ID") for tree in document.trees}
    without: list[Content] = [
        item
        for item in root.content
        if not (isinstance(item, Element) and item.tag in (INCLUDE, MODELS))
    ]
    for name, source in library.own_trees.items():
        if name not in here and source.document is not library.documents[0]:
            without.append(source.element.copy())
    root.content = [
        *without,
        *(item.copy() for d in library.documents for item in d.model_lists[:1]),
    ]
    lists = document.model_lists
    for extra in lists[1:]:
        lists[0].content.extend(extra.content)
        root.content.remove(extra)


def _add_models(document: Document, library: Library) -> None:
    """Add a model for each node that the document uses and that has no model yet."""
    described = set(document.models())
    uses: dict[str, list[Element]] = {}
    for tree in document.trees:
        for element in tree.walk():
            name = type_id(element)
            is_custom = element.tag in EXPLICIT_TAGS - {SUBTREE} and name not in BUILTIN
            if is_custom and name not in described:
                uses.setdefault(name, []).append(element)
    if not uses:
        return
    if not document.model_lists:
        document.root.content.append(Element(MODELS))
    models = document.model_lists[0]
    for name in sorted(uses):
        known = library.models.get(name)
        models.content.append(model_element(known) if known else _guessed_model(name, uses[name]))


def model_element(model: NodeManifest) -> Element:
    """Return a model as an element of <TreeNodesModel>."""
    element = Element(model.category, {"ID": model.id})
    if model.description:
        element.content.append(Element("description", {}, [Text(model.description)]))
    for port in model.ports.values():
        attributes = {"name": port.name}
        if port.type:
            attributes["type"] = port.type
        if port.default is not None:
            attributes["default"] = port.default
        content: list[Content] = [Text(port.description)] if port.description else []
        element.content.append(Element(port.direction, attributes, content))
    return element


def _guessed_model(name: str, uses: list[Element]) -> Element:
    """Guess a model from a node's uses. A port that is given an entry counts as an inout port."""
    element = Element(uses[0].tag, {"ID": name})
    found: dict[str, bool] = {}
    for use in uses:
        for port, value in ports(use).items():
            found[port] = found.get(port, False) or pointer(value, port) is not None
    for port, has_pointer in found.items():
        tag = "inout_port" if has_pointer else "input_port"
        element.content.append(Element(tag, {"name": port}))
    return element


def with_ids(library: Library) -> Document:
    """Return one <BehaviorTree> per SubTree in use, with `_fullpath`, and `_uid` at every node.

    This is how BehaviorTree.CPP describes its nodes to a monitor. Nodes are numbered from 1, depth
    first, those of a SubTree directly after it. Raises FileError if there is no main tree, or if
    the tree cannot be expanded.
    """
    main = library.chosen_tree()
    # Raises FileError for a tree that contains itself, or that is too large.
    expand(library, main)
    root = Element("root", {"BTCPP_format": "4", "main_tree_to_execute": main})

    def begin(source: TreeSource, path: str) -> tuple[Iterator[Element], str]:
        tree = Element(TREE, {"ID": source.id, "_fullpath": path})
        tree.content = [child.copy() for child in source.element.children]
        root.content.append(tree)
        return (element for child in tree.children for element in child.walk()), path

    uid, open_trees = 0, [begin(library.trees[main], "")]
    while open_trees:
        elements, path = open_trees[-1]
        element = next(elements, None)
        if element is None:
            open_trees.pop()
            continue
        uid += 1
        _make_explicit(element, library)
        element.attributes["_uid"] = str(uid)
        if element.tag != SUBTREE:
            element.attributes.setdefault("name", instance_name(element))
            continue
        inner = element.get("ID")
        own = element.get("name") or f"{inner}::{uid}"
        element.attributes["_fullpath"] = full = f"{path}/{own}" if path else own
        if inner in library.trees:
            open_trees.append(begin(library.trees[inner], full))
    document = Document(library.documents[0].file, [root])
    _add_models(document, library)
    return document
