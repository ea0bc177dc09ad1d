"""One meaning per name, and a word about every package."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

from tests.support.structure.source import Finding, files, modules, parsed


def classes_of_one_name(root: Path, package: str) -> list[Finding]:
    """Public classes of a package that share their name with another one."""
    homes: dict[str, list[str]] = defaultdict(list)
    for name, path in modules(root, package).items():
        for node in parsed(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes[node.name].append(name)
    return [
        Finding(name, f"is a public class of {' and of '.join(places)}")
        for name, places in sorted(homes.items())
        if len(places) > 1
    ]


def packages_without_docstring(root: Path, *folders: str) -> list[Finding]:
    """Packages whose __init__.py does not say what lives there."""
    return [
        Finding(path.relative_to(root).as_posix(), "needs a docstring: what lives in this package")
        for path in files(root, "__init__.py", *folders)
        if not ast.get_docstring(parsed(path))
    ]
