"""Tests mirror the packages: a module's tests are found by its name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tests.support.structure.source import Finding, files


def misnamed_tests(root: Path, homes: Mapping[str, str]) -> list[Finding]:
    """Test files that do not bear the name of what they test.

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
    """What tests of a package may be called after: itself, its modules and packages."""
    if not code.is_dir():
        return set()
    inside = {path.stem.strip("_") for path in code.glob("*.py")}
    return {code.name} | inside | {path.name for path in code.iterdir() if path.is_dir()}
