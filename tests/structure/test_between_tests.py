"""Tests stand alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.structure.between_tests import imports_between_tests, path_changes
from tests.support.structure.source import settle

Tree = Callable[[dict[str, str]], Path]


def test_they_import_from_support_alone() -> None:
    settle("imports between tests", imports_between_tests(ROOT))


def test_they_leave_the_path_alone() -> None:
    settle("path changes", path_changes(ROOT))


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("from tests.core.test_b import x", "imports tests.core.test_b; share it"),
        ("import tests.core.helper", "imports tests.core.helper; share it"),
        ("from tests import core", "imports tests.core; share it"),
        ("from tests.core import test_b", "imports tests.core; share it"),
        ("from tests.conftest import x", "imports tests.conftest; share it"),
        ("from tests.supporting import x", "imports tests.supporting; share it"),
        ("from .test_b import x", "imports .test_b; name it in full"),
        ("from . import test_b", "imports .; name it in full"),
        ("def f():\n    from test_b import x", "imports test_b from beside it"),
    ],
)
def test_an_import_of_another_test(tree: Tree, line: str, what: str) -> None:
    root = tree({"tests/core/test_a.py": line, "tests/core/test_b.py": "x = 1"})
    (found,) = imports_between_tests(root)
    assert str(found).startswith(f"tests/core/test_a.py: {what}")


@pytest.mark.parametrize(
    "line",
    [
        "from tests.support.b import x",
        "from tests.support import b",
        "import tests.support.b",
        "import json",
        "from pkg import test_b",
    ],
)
def test_an_import_of_what_is_shared(tree: Tree, line: str) -> None:
    root = tree({"tests/core/test_a.py": line, "tests/support/b.py": "from tests.support import c"})
    assert imports_between_tests(root) == []


@pytest.mark.parametrize(
    "line",
    [
        "sys.path.insert(0, 'x')",
        "def f():\n    sys.path.append('x')",
        "sys.path = []",
        "sys.path += ['x']",
        "sys.path[:] = ['x']",
        "del sys.path[0]",
    ],
)
def test_a_change_of_the_path(tree: Tree, line: str) -> None:
    (found,) = path_changes(tree({"tests/conftest.py": f"import sys\n{line}\n"}))
    assert found.text.startswith("changes sys.path in line ")


@pytest.mark.parametrize(
    "line",
    ["x = list(sys.path)", "monkeypatch.setattr(sys, 'path', list(sys.path))", "os.path.join(a)"],
)
def test_no_change_of_the_path(tree: Tree, line: str) -> None:
    assert path_changes(tree({"tests/test_a.py": line})) == []
