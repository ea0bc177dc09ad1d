"""Tests stand alone: what they share is in tests/support, and they leave Python's path alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.support.structure.source import Finding, files, parsed

SUPPORT = "tests.support"
_CHANGING = ("insert", "append", "extend", "remove", "pop", "clear")


def imports_between_tests(root: Path) -> list[Finding]:
    """Imports of a test file, or of a module beside it, instead of tests/support."""
    found = []
    for path in files(root, ".py", "tests"):
        name = path.relative_to(root).as_posix()
        siblings = {each.stem for each in path.parent.glob("*.py")}
        for module in _imported(parsed(path)):
            if module.split(".")[0] == "tests" and not (module + ".").startswith(SUPPORT + "."):
                found.append(Finding(name, f"imports {module}; share it in tests/support"))
            elif module.startswith("."):
                found.append(Finding(name, f"imports {module}; name it in full"))
            elif module.split(".")[0] in siblings and not (path.parent / module).is_dir():
                found.append(Finding(name, f"imports {module} from beside it; use tests/support"))
    return found


def _imported(tree: ast.Module) -> Iterator[str]:
    """Dotted names of what is imported; of `from a import b`, `a.b` where `a` is a package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = "." * node.level + (node.module or "")
            if source in ("tests", SUPPORT):
                yield from (f"{source}.{alias.name}" for alias in node.names)
            else:
                yield source


def path_changes(root: Path) -> list[Finding]:
    """Assignments to sys.path, and calls that change it; pytest's monkeypatch undoes its own."""
    found = []
    for path in files(root, ".py", "tests"):
        name = path.relative_to(root).as_posix()
        for node in ast.walk(parsed(path)):
            if _changes_path(node):
                found.append(Finding(name, f"changes sys.path in line {node.lineno}"))  # type: ignore[attr-defined]
    return found


def _changes_path(node: ast.AST) -> bool:
    if isinstance(node, ast.Assign | ast.AugAssign | ast.Delete):
        targets = [node.target] if isinstance(node, ast.AugAssign) else node.targets
        return any(_is_path(part) for target in targets for part in ast.walk(target))
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in _CHANGING
        and _is_path(node.func.value)
    )


def _is_path(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Attribute)
        and node.attr == "path"
        and isinstance(node.value, ast.Name)
        and node.value.id == "sys"
    )
