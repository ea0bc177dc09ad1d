"""Read YAML into plain data, with the line of every value.

ruamel.yaml composes the node graph, but its constructors do not turn the graph into data: every
duplicate key has to be reported with both lines, and aliases must not multiply into more data than
the limits allow.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from mrbt_mesh.errors import FileError, Problem, read_limited, whole_file_error
from mrbt_mesh.formats.problems import Report, SourcePath, found
from mrbt_mesh.formats.yaml_syntax import explain_yaml

MAX_YAML_BYTES = 1 << 20
MAX_LEVELS = 200
MAX_VALUES = 100_000
MAX_INTEGER = 2**63 - 1

_TAG = "tag:yaml.org,2002:"
_TEXT_TAGS = frozenset({_TAG + "str", _TAG + "timestamp", _TAG + "value"})
_TRUE = frozenset({"true", "yes", "on", "y"})
_RADIX = {"0x": 16, "0o": 8, "0b": 2}


class SourceDict(dict[str, Any]):
    """A mapping of the file that knows its place in it."""

    path: SourcePath = ()


class _TooMuchError(Exception):
    """The file unfolds into more than the limits allow; carries place and message."""

    def __init__(self, path: SourcePath, message: str) -> None:
        super().__init__(message)
        self.path = path
        self.message = message


def decode(content: bytes, file: str) -> str:
    """Return the text of a file. Raises FileError, with the line, if it is not UTF-8."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = f"not a text file in UTF-8 (byte {error.start} is {content[error.start]:#04x})"
        raise FileError([Problem(file, line, "", message)]) from None


def read_mapping(
    path: Path | str, expected: str, text: str | None = None
) -> tuple[SourceDict, Report]:
    """Read the mapping in a file, as `read_yaml` does. Raises FileError if it is not a mapping.

    With `text` no file is read, and `path` is for messages only. `expected` begins the error.
    """
    if text is None:
        text = decode(read_limited(Path(path), MAX_YAML_BYTES), str(path))
    data, report = read_yaml(text, str(path))
    if not isinstance(data, SourceDict):
        raise whole_file_error(str(path), f"{expected}, found {found(data)}")
    return data, report


def read_yaml(text: str, file: str) -> tuple[Any, Report]:
    """Return plain data (mappings are SourceDict) and a report that knows all lines.

    Duplicate keys and unusable values are noted in the report and left out. Raises FileError if no
    data can be read: broken syntax, more than `MAX_LEVELS` levels or `MAX_VALUES` values once
    aliases are unfolded.
    """
    node = _compose(text, file)
    lines: dict[SourcePath, int] = {}
    report = Report(file, lines)
    if node is None:
        raise whole_file_error(file, "the file is empty")
    try:
        data = _Unfolder(report, lines).unfold(node, ())
    except _TooMuchError as error:
        report.add(error.path, error.message)
        report.raise_if_any()
    except RecursionError:
        raise whole_file_error(file, _too_deep()) from None
    return data, report


def _compose(text: str, file: str) -> Node | None:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            node: Node | None = YAML(typ="safe", pure=True).compose(text)
            return node
    except YAMLError as error:
        line, said = explain_yaml(error, text)
        raise FileError([Problem(file, line, "", f"not valid YAML: {said}")]) from None
    except RecursionError:
        raise whole_file_error(file, _too_deep()) from None
    except Exception as error:
        # The parser fails on some malformed input with exceptions of any type.
        raise whole_file_error(file, f"not valid YAML: {error!r}") from None


def _too_deep() -> str:
    return f"nested deeper than {MAX_LEVELS} levels; move inner parts to subtrees"


class _Unfolder:
    def __init__(self, report: Report, lines: dict[SourcePath, int]) -> None:
        self.report = report
        self.lines = lines
        self.count = 0
        self.open: set[int] = set()

    def unfold(self, node: Node, path: SourcePath) -> Any:
        self.lines.setdefault(path, node.start_mark.line + 1)
        self.count += 1
        if self.count > MAX_VALUES:
            raise _TooMuchError(path, f"more than {MAX_VALUES} values once aliases are unfolded")
        if isinstance(node, ScalarNode):
            return self.scalar(node, path)
        if id(node) in self.open:
            raise _TooMuchError(path, f"the alias *{node.anchor} contains itself")
        if len(self.open) >= MAX_LEVELS:
            raise _TooMuchError(path, _too_deep())
        self.open.add(id(node))
        data: Any = None
        # Not a helper function, which would use one more of Python's stack frames per level.
        if isinstance(node, SequenceNode) and _tag(node) == _TAG + "seq":
            data = []
            for i, item in enumerate(node.value):
                data.append(self.unfold(item, (*path, i)))
        elif isinstance(node, MappingNode) and _tag(node) == _TAG + "map":
            data = self.mapping(node, path)
        else:
            self.report.add(path, f"the tag {_tag(node)} is not supported; remove it")
        self.open.remove(id(node))
        return data

    def mapping(self, node: MappingNode, path: SourcePath) -> SourceDict:
        data = SourceDict()
        data.path = path
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            key = self.key(key_node, path, line)
            if key is None:
                continue
            here = (*path, key)
            if key in data:
                text = f"{key!r} is given twice, first on line {self.lines[here]}"
                self.report.add(here, f"{text}; keep one of them", line)
                continue
            self.lines[here] = line
            data[key] = self.unfold(value_node, here)
        return data

    def key(self, node: Node, path: SourcePath, line: int) -> str | None:
        tag = _tag(node)
        if tag == _TAG + "merge":
            message = "merge keys (<<) are not supported; use a subtree or a parameter"
        elif not isinstance(node, ScalarNode) or tag not in (*_TEXT_TAGS, _TAG + "int"):
            message = "a key must be a name, e.g. A1; put it in quotes"
        else:
            text: str = node.value
            return text if _encodes(text) else None
        self.report.add(path, message, line)
        return None

    def scalar(self, node: ScalarNode, path: SourcePath) -> Any:
        tag, text = _tag(node), node.value
        if tag == _TAG + "null":
            return None
        if tag == _TAG + "bool":
            return text.lower() in _TRUE
        if tag in (_TAG + "int", _TAG + "float"):
            try:
                return _integer(text) if tag == _TAG + "int" else _number(text)
            except ValueError:
                message = "a finite number below 2^63 is expected, found"
                self.report.add(path, f"{message} {found(text)}")
                return 1  # Stands in, so that this number is not reported twice.
        if tag not in _TEXT_TAGS:
            self.report.add(path, f"the tag {tag} is not supported; remove it")
        elif not _encodes(text):
            self.report.add(path, "the text holds half a surrogate pair; remove it")
        else:
            return text
        return None


def _tag(node: Node) -> str:
    return str(node.tag)


def _encodes(text: str) -> bool:
    return not any("\ud800" <= character <= "\udfff" for character in text)


def _integer(text: str) -> int:
    digits = text.replace("_", "").lower()
    sign = -1 if digits.startswith("-") else 1
    digits = digits.lstrip("+-")
    value = sign * int(digits, _RADIX.get(digits[:2], 10))
    if abs(value) > MAX_INTEGER:
        raise ValueError(text)
    return value


def _number(text: str) -> float:
    value = float(text.replace("_", ""))
    if not math.isfinite(value):
        raise ValueError(text)
    return value
