"""Files to check, and what a check has found."""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest


@dataclass(frozen=True, order=True)
class Finding:
    """What breaks a rule. `key` names the place and stays the same when lines move."""

    key: str
    text: str

    def __str__(self) -> str:
        return f"{self.key}: {self.text}"


def settle(check: str, findings: Sequence[Finding]) -> None:
    """Fail the test, with a line for each finding."""
    if findings:
        pytest.fail("\n".join([f"{check}:", *map(str, findings)]), pytrace=False)


def files(root: Path, suffix: str, *folders: str) -> list[Path]:
    """Files of one kind in some folders of `root`, sorted; hidden folders are left out."""
    found = (path for folder in folders for path in (root / folder).rglob(f"*{suffix}"))
    return sorted(p for p in found if not any(x[0] == "." for x in p.relative_to(root).parts))


def modules(root: Path, *packages: str) -> dict[str, Path]:
    """Modules of some packages by their dotted names; a package's is that of its __init__.py."""
    found = {}
    for path in files(root, ".py", *packages):
        parts = path.relative_to(root).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a Python file."""
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def classes(path: Path) -> Iterator[ast.ClassDef]:
    """All classes of a file, wherever they stand in it."""
    return (node for node in ast.walk(parsed(path)) if isinstance(node, ast.ClassDef))
