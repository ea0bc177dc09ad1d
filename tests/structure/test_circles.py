"""No circle of imports, wherever an import stands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.structure.circles import circles, imports
from tests.support.structure.source import settle

Tree = Callable[[dict[str, str]], Path]


def test_there_is_none() -> None:
    settle("circles", circles(ROOT, "mrbt_mesh"))


@pytest.mark.parametrize(
    "back",
    [
        "from pkg import a",
        "from pkg.a import x",
        "import pkg.a",
        "import pkg.a as other",
        "from . import a",
        "from .a import x",
        "def f():\n    from pkg.a import x",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pkg.a import x",
    ],
)
def test_two_modules_that_import_each_other(tree: Tree, back: str) -> None:
    root = tree({"pkg/__init__.py": "", "pkg/a.py": "from pkg.b import y", "pkg/b.py": back})
    (found,) = circles(root, "pkg")
    assert str(found) == "pkg.a imports pkg.b imports pkg.a: a circle of imports"


def test_a_longer_circle_is_named_in_its_order(tree: Tree) -> None:
    root = tree(
        {
            "pkg/__init__.py": "",
            "pkg/deep/__init__.py": "from pkg.deep.one import x",
            "pkg/deep/one.py": "from pkg import two",
            "pkg/two.py": "from pkg.deep import x",
            "pkg/aside.py": "import pkg.two",
        }
    )
    (found,) = circles(root, "pkg")
    assert found.key == "pkg.deep imports pkg.deep.one imports pkg.two imports pkg.deep"


def test_circles_beside_each_other_are_all_named(tree: Tree) -> None:
    files = {f"pkg/{a}.py": f"import pkg.{b}" for a, b in ("ab", "ba", "cd", "dc")}
    root = tree({"pkg/__init__.py": "", **files, "pkg/e.py": "import pkg.a, pkg.c"})
    assert [found.key for found in circles(root, "pkg")] == [
        *("pkg.a imports pkg.b imports pkg.a", "pkg.c imports pkg.d imports pkg.c"),
    ]


def test_names_that_are_no_modules_are_imports_of_their_module(tree: Tree) -> None:
    root = tree(
        {
            "pkg/__init__.py": "from pkg.a import x",
            "pkg/a.py": "import json, os.path, pkgother.b",
            "pkg/b.py": "from pkg import x, a",
            "pkg/sub/__init__.py": "from . import c\nfrom .c import y\nfrom .. import b",
            "pkg/sub/c.py": "from ..a import x",
        }
    )
    assert imports(root, "pkg") == {
        "pkg": {"pkg.a"},
        "pkg.a": set(),
        "pkg.b": {"pkg", "pkg.a"},
        "pkg.sub": {"pkg.sub.c", "pkg.b"},
        "pkg.sub.c": {"pkg.a"},
    }
    assert circles(root, "pkg") == []
