"""Settings of all tests: examples of properties, a state folder of their own, what was skipped."""

from __future__ import annotations

import functools
import gc
import os
import shutil
import sys
import tempfile
from collections import Counter
from typing import Any

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings

# As where the package is installed: pytest finds it by its entry point.
from mrbt_mesh.pytest_plugin import run_mission as run_mission
from tests.support.effort import EXAMPLES

settings.register_profile(
    "project",
    # A failure prints what replays it, and no clock decides.
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
    max_examples=EXAMPLES,
)
settings.load_profile("project")

_STATE = "MRBT_STATE_DIR"

# Tests start hundreds of Pythons: without bytecode each compiles all that it imports anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


# Suites of the gate run all that is marked so; make test has some of it, or none.
_OF_SUITES = ("browser", "docker", "processes", "slow", "soak")
# Modules that name this try more in the gate; so do properties, wherever they are.
_SIZED = "tests.support.effort"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--beyond-quick",
        action="store_true",
        help="only tests that `make test` does not run, or of which it tries less",
    )


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what `make test` runs just so, if that is asked for."""
    if not config.getoption("--beyond-quick"):
        return
    is_sized = functools.cache(lambda path: _SIZED in path.read_text("utf-8"))
    left_out = {
        item
        for item in items
        if not any(item.get_closest_marker(name) for name in _OF_SUITES)
        and not is_sized(item.path)
        and not is_hypothesis_test(getattr(item, "obj", None))
    }
    config.hook.pytest_deselected(items=[item for item in items if item in left_out])
    items[:] = [item for item in items if item not in left_out]


def pytest_configure(config: pytest.Config) -> None:
    """No run of a test is left in the user's own state folder. Workers inherit the variable."""
    if not hasattr(config, "workerinput"):
        os.environ[_STATE] = folder = tempfile.mkdtemp(prefix="mrbt-tests-")
        config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_collection_finish() -> None:
    """Thousands of collected tests stay: a collection of garbage need not go through them again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Why tests were skipped, and how many for each reason."""
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(each.longrepr[2].removeprefix("Skipped: ") for each in skipped)
    if reasons:
        terminalreporter.section("skipped")
    for reason, count in sorted(reasons.items(), key=lambda each: (-each[1], each[0])):
        terminalreporter.line(f"{count:5} {reason}")
