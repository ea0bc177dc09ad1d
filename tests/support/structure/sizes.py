"""How large files, functions and classes may be."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.support.structure.source import Finding, classes, files, parsed

MAX_LINES = 450
MAX_FUNCTION_LINES = 70
MAX_ATTRIBUTES = 12
# Written directly above a class (or its decorators) that has more, with the reason after it.
REASON = "# Attributes: "


def long_files(root: Path, *folders: str) -> list[Finding]:
    """Files with too many lines."""
    counted = {path: len(path.read_text("utf-8").splitlines()) for path in _python(root, folders)}
    return [
        Finding(_name(root, path), f"{lines} lines, at most {MAX_LINES} are allowed")
        for path, lines in counted.items()
        if lines > MAX_LINES
    ]


def long_functions(root: Path, *folders: str) -> list[Finding]:
    """Functions and methods with too many lines, decorators not counted."""
    found = []
    for path in _python(root, folders):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if lines > MAX_FUNCTION_LINES:
                    text = f"{lines} lines, at most {MAX_FUNCTION_LINES} are allowed"
                    found.append(Finding(f"{_name(root, path)}: {node.name}", text))
    return found


def crowded_classes(root: Path, *folders: str) -> list[Finding]:
    """Classes with too many attributes and no reason given above them."""
    found = []
    for path in _python(root, folders):
        lines = path.read_text(encoding="utf-8").splitlines()
        for node in classes(path):
            count = len(set(_attributes(node)))
            if count > MAX_ATTRIBUTES and not _has_reason(node, lines):
                text = f"{count} attributes; more than {MAX_ATTRIBUTES} need '{REASON}why' above it"
                found.append(Finding(f"{_name(root, path)}: {node.name}", text))
    return found


def needless_reasons(root: Path, *folders: str) -> list[Finding]:
    """Reasons above classes that do not have so many attributes, or above no class at all."""
    found = []
    for path in _python(root, folders):
        lines = path.read_text(encoding="utf-8").splitlines()
        given = [number for number, line in enumerate(lines) if line.strip().startswith(REASON)]
        used = [
            number
            for node in classes(path)
            for number in _comment(node, lines)
            if len(set(_attributes(node))) > MAX_ATTRIBUTES
        ]
        found += [
            Finding(f"{_name(root, path)}: {number + 1}", "this reason is not needed")
            for number in given
            if number not in used
        ]
    return found


def _attributes(node: ast.ClassDef) -> Iterator[str]:
    """Fields of a dataclass or model, and what methods set on their first argument."""
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name):
            if "ClassVar" not in ast.unparse(item.annotation):
                yield item.target.id
        elif isinstance(item, ast.FunctionDef | ast.AsyncFunctionDef) and item.args.args:
            me = item.args.args[0].arg
            for part in ast.walk(item):
                if (
                    isinstance(part, ast.Attribute)
                    and isinstance(part.ctx, ast.Store)
                    and isinstance(part.value, ast.Name)
                    and part.value.id == me
                ):
                    yield part.attr


def _comment(node: ast.ClassDef, lines: list[str]) -> list[int]:
    """Numbers, from 0, of the comment lines directly above a class."""
    first = min([node.lineno, *(each.lineno for each in node.decorator_list)]) - 1
    found = []
    while first > 0 and lines[first - 1].strip().startswith("#"):
        first -= 1
        found.append(first)
    return found


def _has_reason(node: ast.ClassDef, lines: list[str]) -> bool:
    return any(lines[number].strip().startswith(REASON) for number in _comment(node, lines))


def _python(root: Path, folders: tuple[str, ...]) -> list[Path]:
    return files(root, ".py", *folders)


def _name(root: Path, path: Path) -> str:
    return path.relative_to(root).as_posix()
