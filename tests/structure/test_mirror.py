"""A module's tests are found by its name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.paths import ROOT
from tests.support.structure.source import misnamed_tests, settle

Tree = Callable[[dict[str, str]], Path]

PACKAGES = (
    *("adapters", "analysis", "btcpp", "cli", "core", "drills", "features", "formats"),
    *("observer", "recording", "runtime", "sim", "views"),
)
HOMES = {name: f"mrbt_mesh/{name}" for name in PACKAGES}
HOMES |= {name: name for name in ("agents", "benchmarks", "examples", "paper")}


def test_tests_bear_the_names_of_what_they_test() -> None:
    settle("mirror", misnamed_tests(ROOT, HOMES))


def test_names_that_fit_and_that_do_not(tree: Tree) -> None:
    good = (
        *("facts/test_store", "facts/test_store_in_any_order", "facts/conftest"),
        *("facts/test_facts_together", "test_facts", "test_main"),
    )
    bad = ("facts/test_storage", "gone/test_gone", "test_store")
    code = {"pkg/core/facts/store.py": "", "pkg/core/__main__.py": ""}
    tests = {f"tests/core/{name}.py": "" for name in (*good, *bad)}
    found = misnamed_tests(tree(code | tests | {"tests/o/test_x.py": ""}), {"core": "pkg/core"})
    assert [str(each) for each in found] == [
        "tests/core/facts/test_storage.py: nothing in pkg/core/facts/ has this name",
        "tests/core/gone/test_gone.py: nothing in pkg/core/gone/ has this name",
        "tests/core/test_store.py: nothing in pkg/core/ has this name",
    ]
