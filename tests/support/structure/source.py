"""Files to check, findings, and the rules about names and packages."""

from __future__ import annotations

import ast
import functools
from collections import defaultdict
from collections.abc import Mapping, Sequence
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


def misnamed_tests(root: Path, homes: Mapping[str, str]) -> list[Finding]:
    """Test files that are not called after the code that they test: tests mirror the packages.

    `homes` names the code that the folders in tests/ are about: `{"core": "mrbt_mesh/core"}`. The
    file tests/core/facts/test_store_x.py is about mrbt_mesh/core/facts/store.py, or a package of
    that name; test_facts.py beside it is about the package itself.
    """
    found = []
    for folder, home in homes.items():
        top = root / "tests" / folder
        for path in files(root, ".py", f"tests/{folder}"):
            if path.name.startswith("test_"):
                code = root / home / path.parent.relative_to(top)
                name = path.stem.removeprefix("test_")
                if not any(name == known or name.startswith(f"{known}_") for known in _names(code)):
                    text = f"nothing in {code.relative_to(root).as_posix()}/ has this name"
                    found.append(Finding(path.relative_to(root).as_posix(), text))
    return found


def _names(code: Path) -> set[str]:
    """The names for tests of a package: its own, and those of its modules and packages."""
    if not code.is_dir():
        return set()
    inside = {path.stem.strip("_") for path in code.glob("*.py")}
    return {code.name} | inside | {path.name for path in code.iterdir() if path.is_dir()}


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
    """Packages whose __init__.py has no docstring."""
    return [
        Finding(path.relative_to(root).as_posix(), "needs a docstring: what lives in this package")
        for path in files(root, "__init__.py", *folders)
        if not ast.get_docstring(parsed(path))
    ]
