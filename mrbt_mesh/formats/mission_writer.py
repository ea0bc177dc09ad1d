"""Write mission files for tools: a tree as the YAML that people would write."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any, TypeVar

from ruamel.yaml import YAML
from ruamel.yaml.nodes import CollectionNode, MappingNode, SequenceNode
from ruamel.yaml.representer import SafeRepresenter

from mrbt_mesh.core.bt.tree import CONTROLS, LEAVES, Kind, Memory, NodeSpec

# A text that is broken into lines is not a valid key, and the library breaks keys, too.
_UNBROKEN = 1 << 30
# The parts of a longer collection are written on one line each.
MAX_LINE = 85


def tree_data(spec: NodeSpec) -> Any:
    """Return a ground node as plain data of a mission file. SubTrees are replaced by their
    content.
    """
    if spec.kind is Kind.ACTION:
        return spec.subject
    if spec.kind in LEAVES:
        return {str(spec.kind): spec.subject}
    if spec.kind is Kind.JOBS:
        types = [child.name for child in spec.children]
        return {str(spec.kind): {"types": types, "at_most": spec.limit}}
    children = [tree_data(child) for child in spec.children]
    if spec.kind is Kind.SUBTREE:
        (child,) = children
        return child
    if spec.kind in CONTROLS:
        return {str(spec.kind): _control(spec, children)}
    (child,) = children
    named: dict[str, Any] = {"name": spec.name} if spec.name else {}
    match spec.kind:
        case Kind.RETRY:
            return {str(spec.kind): named | {"attempts": spec.limit, "do": child}}
        case Kind.REPEAT:
            return {str(spec.kind): named | {"cycles": spec.limit, "do": child}}
        case Kind.TIMEOUT:
            return {str(spec.kind): named | {"seconds": spec.timeout_us / 1e6, "do": child}}
    return {str(spec.kind): child}


def _control(spec: NodeSpec, children: list[Any]) -> Any:
    body: dict[str, Any] = {}
    if spec.name:
        body["name"] = spec.name
    if spec.memory is not Memory.NONE:
        body["memory"] = str(spec.memory)
    if spec.kind is Kind.PARALLEL:
        body["success"] = "all" if spec.limit == len(children) else spec.limit
        if spec.failures:
            body["failures"] = spec.failures
    return {**body, "children": children} if body else children


class _Representer(SafeRepresenter):
    """Writes a collection on one line if it contains no other collection and fits."""

    def represent_mapping(self, tag: Any, mapping: Any, flow_style: Any = None) -> MappingNode:
        node: MappingNode = super().represent_mapping(tag, mapping, flow_style=flow_style)
        return _fitting(node, [part.value for pair in node.value for part in pair])

    def represent_sequence(self, tag: Any, sequence: Any, flow_style: Any = None) -> SequenceNode:
        node: SequenceNode = super().represent_sequence(tag, sequence, flow_style=flow_style)
        return _fitting(node, [part.value for part in node.value])


_Node = TypeVar("_Node", bound=CollectionNode)


def _fitting(node: _Node, texts: list[Any]) -> _Node:
    if node.flow_style and sum(len(text) + 2 for text in texts) > MAX_LINE:
        node.flow_style = False
    return node


def mission_text(data: Mapping[str, Any], heading: str) -> str:
    """Return a mission file with `data`; `heading` becomes the comment at its beginning."""
    writer = YAML(typ="safe", pure=True)
    writer.Representer = _Representer
    writer.default_flow_style = None  # one line for a collection that contains no other one
    writer.width = _UNBROKEN
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    stream = io.StringIO()
    writer.dump(dict(data), stream)
    comment = "".join(f"# {line}".rstrip() + "\n" for line in heading.splitlines())
    # A blank line between sections.
    return comment + re.sub(r"^(?=[^\s-])", "\n", stream.getvalue(), flags=re.MULTILINE)
