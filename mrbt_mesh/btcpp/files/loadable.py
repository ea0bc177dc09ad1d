"""Rewrites documents into equivalent forms that BehaviorTree.CPP 4.7 and later loads."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable

from mrbt_mesh.btcpp.files.builtin_nodes import BOOLEAN, INTEGER, LOOP_ITEMS
from mrbt_mesh.btcpp.files.document import (
    EXPLICIT_TAGS,
    INCLUDE,
    MODELS,
    SUBTREE,
    TREE,
    Document,
    conditions,
    type_id,
)
from mrbt_mesh.btcpp.files.elements import Comment, Content, Element, Instruction
from mrbt_mesh.btcpp.files.expand import SCRIPT_PORTS
from mrbt_mesh.btcpp.scripts.parser import single_quoted
from mrbt_mesh.btcpp.scripts.script import ScriptError

_TAG = re.compile(r"[^\W\d][\w.-]*")
_JSON = "json:"


def compact(document: Document) -> Document:
    """Return the document in the compact form: `<Foo .../>` for `<Action ID="Foo" .../>`."""
    result = document.copy()
    for tree in result.trees:
        _make_compact(element for element in tree.walk() if element is not tree)
    return result


def loadable(document: Document) -> Document:
    """Return the document without forms that BehaviorTree.CPP refuses.

    It refuses <Action ID=...> below a ReactiveSequence, `<?...?>` after the beginning of the file,
    `json:` lists in queues, and double-quoted texts in scripts.
    """
    result = document.copy()
    for element in result.root.walk():
        element.content = [_as_comment(item) for item in element.content]
    is_first = True
    for number, item in enumerate(result.items):
        is_first = is_first and isinstance(item, Instruction)
        result.items[number] = item if is_first else _as_comment(item)
    for tree in result.trees:
        for element in tree.walk():
            name = type_id(element)
            if name == "ReactiveSequence":
                _make_compact(element.children)
            for attribute in (*conditions(element), SCRIPT_PORTS.get(name, "")):
                if attribute in element.attributes:
                    element.attributes[attribute] = _single_quoted(element.get(attribute))
            if name in LOOP_ITEMS and "queue" in element.attributes:
                element.attributes["queue"] = _plain_list(LOOP_ITEMS[name], element.get("queue"))
    return result


def _make_compact(elements: Iterable[Element]) -> None:
    for element in elements:
        name = element.get("ID")
        # Some names cannot be tags; those nodes keep the explicit form.
        if element.tag in EXPLICIT_TAGS - {SUBTREE} and _is_tag(name):
            del element.attributes["ID"]
            element.tag = name


def _is_tag(name: str) -> bool:
    """Return whether a name can be an XML tag without another meaning."""
    if name in EXPLICIT_TAGS or name in (TREE, MODELS, INCLUDE, "root"):
        return False
    return _TAG.fullmatch(name) is not None and not name.lower().startswith("xml")


def _as_comment(item: Content) -> Content:
    if not isinstance(item, Instruction):
        return item
    text = f"?{item.target} {item.data}".rstrip()
    while "--" in text:
        text = text.replace("--", "- -")
    return Comment(f"{text}?")


def _single_quoted(script: str) -> str:
    try:
        return single_quoted(script)
    except ScriptError:
        return script


def _plain_list(kind: str, text: str) -> str:
    """Rewrite `json:[1, 2]` as `1;2`, if that means the same."""
    if not text.startswith(_JSON):
        return text
    try:
        items = json.loads(text[len(_JSON) :])
    except (ValueError, RecursionError):
        return text
    if not isinstance(items, list) or not items:
        return text
    wanted: dict[str, tuple[type, ...]] = {
        INTEGER: (int,),
        BOOLEAN: (bool,),
        "double": (int, float),
    }
    types = wanted.get(kind, (str,))
    if not all(type(item) in types for item in items):
        return text
    plain = [item if isinstance(item, str) else json.dumps(item) for item in items]
    is_same = all(item.strip() == item != "" and ";" not in item for item in plain)
    return ";".join(plain) if is_same and not plain[0].startswith(_JSON) else text
