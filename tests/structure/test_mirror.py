"""A module's tests are found by its name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.structure.mirror import misnamed_tests
from tests.support.structure.source import settle

Tree = Callable[[dict[str, str]], Path]

PACKAGES = (
    *("adapters", "analysis", "btcpp", "cli", "core", "drills", "formats"),
    *("recording", "runtime", "sim", "views"),
)
HOMES = {name: f"mrbt_mesh/{name}" for name in PACKAGES}
HOMES |= {name: name for name in ("agents", "benchmarks", "examples", "paper")}


def test_tests_bear_the_names_of_what_they_test() -> None:
    settle("mirror", misnamed_tests(ROOT, HOMES))


def test_names_that_fit(tree: Tree) -> None:
    root = tree(
        {
            "pkg/core/facts/store.py": "",
            "pkg/core/__main__.py": "",
            "tests/core/facts/test_store.py": "",
            "tests/core/facts/test_store_in_any_order.py": "",
            "tests/core/facts/conftest.py": "",
            "tests/core/facts/test_facts_together.py": "",
            "tests/core/test_facts.py": "",
            "tests/core/test_main.py": "",
            "tests/other/test_anything.py": "",
        }
    )
    assert misnamed_tests(root, {"core": "pkg/core"}) == []


def test_names_that_do_not_fit(tree: Tree) -> None:
    root = tree(
        {
            "pkg/core/facts/store.py": "",
            "tests/core/test_store.py": "",
            "tests/core/facts/test_storage.py": "",
            "tests/core/gone/test_gone.py": "",
        }
    )
    found = misnamed_tests(root, {"core": "pkg/core"})
    assert [str(each) for each in found] == [
        "tests/core/facts/test_storage.py: nothing in pkg/core/facts/ has this name",
        "tests/core/gone/test_gone.py: nothing in pkg/core/gone/ has this name",
        "tests/core/test_store.py: nothing in pkg/core/ has this name",
    ]
