"""Files, functions and classes are small, or a class says why it is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT
from tests.support.structure.sizes import (
    crowded_classes,
    long_files,
    long_functions,
    needless_reasons,
)
from tests.support.structure.source import Finding, settle

Tree = Callable[[dict[str, str]], Path]

FOLDERS = ("mrbt_mesh", "agents", "benchmarks", "drills", "examples", "paper", "tests")
FIELDS = "".join(f"    f{number}: int\n" for number in range(12))


def test_no_file_is_too_long() -> None:
    settle("files", long_files(ROOT, *FOLDERS))


def test_no_function_is_too_long() -> None:
    settle("functions", long_functions(ROOT, *FOLDERS))


def test_no_class_has_too_many_attributes() -> None:
    settle("classes", crowded_classes(ROOT, *FOLDERS))


def test_no_reason_is_given_where_none_is_needed() -> None:
    settle("reasons", needless_reasons(ROOT, *FOLDERS))


def test_a_long_file(tree: Tree) -> None:
    root = tree({"a/ok.py": "x = 1\n" * 450, "a/b/long.py": "x = 1\n" * 451, "c/d.py": "\n" * 999})
    assert [str(each) for each in long_files(root, "a")] == [
        "a/b/long.py: 451 lines, at most 450 are allowed"
    ]


@pytest.mark.parametrize("kind", ["def", "async def"])
def test_a_long_function(tree: Tree, kind: str) -> None:
    text = "class C:\n    @property\n    {} {}(self):\n{}"
    root = tree(
        {
            "a/ok.py": text.format(kind, "ok", "        x = 1\n" * 69),
            "a/long.py": text.format(kind, "long", "        x = 1\n" * 70),
        }
    )
    (found,) = long_functions(root, "a")
    assert str(found) == "a/long.py: long: 71 lines, at most 70 are allowed"


@pytest.mark.parametrize(
    "more",
    [
        "    f13: int = 0\n",
        "    def __init__(self) -> None:\n        self.x = 1\n",
        "    def f(me) -> None:\n        if True:\n            me.x, y = 1, 2\n",
        "    async def f(self) -> None:\n        self._x: int = 1\n",
    ],
)
def test_a_crowded_class(tree: Tree, more: str) -> None:
    root = tree({"a/b.py": f"@dataclass\nclass Many:\n{FIELDS}{more}"})
    (found,) = crowded_classes(root, "a")
    assert found.key == "a/b.py: Many"
    assert found.text.startswith("13 attributes; more than 12 need '# Attributes: why'")


@pytest.mark.parametrize(
    "more",
    [
        "",
        "    shared: ClassVar[int] = 0\n",
        "    constant = 1\n",
        "    def f(self, other: int) -> None:\n        other.x = self.f3 = self.y\n",
    ],
)
def test_a_class_that_is_not_crowded(tree: Tree, more: str) -> None:
    assert crowded_classes(tree({"a/b.py": f"class Few:\n{FIELDS}{more}"}), "a") == []


def test_a_reason_stands_directly_above_the_class(tree: Tree) -> None:
    many = f"class Many:\n{FIELDS}    f13: int\n"
    reason = "# Attributes: the keys of the file.\n"
    root = tree(
        {
            "a/plain.py": f"x = 1\n{reason}{many}",
            "a/decorated.py": f"{reason}# It is long.\n@dataclass\n@other\n{many}",
            "a/inside.py": "class A:\n    # Attributes: one each.\n    class B:\n"
            + "".join(f"        f{n}: int\n" for n in range(13)),
            "a/apart.py": f"{reason}\n{many}",
        }
    )
    assert [each.key for each in crowded_classes(root, "a")] == ["a/apart.py: Many"]
    assert [each.key for each in needless_reasons(root, "a")] == ["a/apart.py: 1"]


def test_a_reason_above_a_class_that_needs_none(tree: Tree) -> None:
    root = tree({"a/b.py": "# Attributes: many.\nclass Few:\n    x: int\n"})
    assert [str(each) for each in needless_reasons(root, "a")] == [
        "a/b.py: 1: this reason is not needed"
    ]


def test_a_finding_fails_the_test_with_a_line_that_says_what() -> None:
    with pytest.raises(pytest.fail.Exception, match=r"^nothing:\na.py: 500 lines$"):
        settle("nothing", [Finding("a.py", "500 lines")])
    settle("nothing", [])
