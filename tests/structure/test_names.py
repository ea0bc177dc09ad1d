"""One meaning per name, and a word about every package."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.structure.source import (
    classes_of_one_name,
    packages_without_docstring,
    settle,
)

Tree = Callable[[dict[str, str]], Path]


def test_no_two_public_classes_have_one_name() -> None:
    settle("class names", classes_of_one_name(ROOT, "mrbt_mesh"))


def test_every_package_says_what_lives_there() -> None:
    found = packages_without_docstring(ROOT, "mrbt_mesh", "benchmarks", "paper", "tests")
    settle("docstrings", found)


def test_two_classes_of_one_name(tree: Tree) -> None:
    both = "class Team: ...\nclass _Team: ...\n"
    root = tree(
        {"pkg/__init__.py": "", "pkg/a.py": both, "pkg/b.py": both, "pkg/c.py": "class A: ..."}
    )
    assert [str(each) for each in classes_of_one_name(root, "pkg")] == [
        "Team: is a public class of pkg.a and of pkg.b"
    ]


def test_a_package_without_a_docstring(tree: Tree) -> None:
    root = tree({"a/__init__.py": "", "a/b/__init__.py": '"""B."""', "a/c/__init__.py": "x = 1"})
    found = [each.key for each in packages_without_docstring(root, "a")]
    assert found == ["a/__init__.py", "a/c/__init__.py"]
