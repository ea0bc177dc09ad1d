"""How much the kernel knows of features. Each figure may only fall: write the lower one here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.walk.__main__ import kill, outcome
from mrbt_mesh.core.feature import NAMES, Feature, features
from tests.support.mesh_alone import copy_mesh, run, without_features
from tests.support.paths import ROOT
from tests.support.structure.rooms import OWN_FILES, WORDS, loaded_lines, naming

Tree = Callable[[dict[str, str]], Path]

# Feature -> how many lines of the kernel name it, and how many of these ask for something.
NAMED = {
    "bids": (0, 0),
    "constraints": (33, 12),
    "contact": (0, 0),
    "exclusive": (0, 0),
    "jobs": (177, 58),
    "keys": (117, 33),
    "large_teams": (11, 3),
    "revisions": (32, 10),
    "travel": (326, 88),
    "values": (0, 0),
}
# Lines of code of the modules that a robot's process imports before it begins.
LOADED_LINES = 19_054
# Files that an event enters, and edges between them: the step of an outcome, all of a kill.
WALKS = {"step": (38, 156), "kill": (45, 188)}
# Tests of trees, facts, members, planning, assignment and the agent which use no feature that has
# a room; with what runs them.
KERNEL = (
    "tests/core/agent/test_agent_scripts.py",
    "tests/core/bt",
    "tests/core/facts/test_store.py",
    "tests/core/membership/test_failure_detector.py",
    "tests/core/planning/test_make_plan.py",
    "tests/runtime/test_driver.py",
    "tests/sim/test_run_plain_examples.py",
    "tests/sim/test_run_the_end.py",
)
REMEDY = "write the lower figure, so that it stays there"


@pytest.mark.parametrize("feature", sorted(WORDS))
def test_fewer_lines_of_the_kernel_name_a_feature(feature: str) -> None:
    found = naming(ROOT / "mrbt_mesh" / "core")[feature]
    assert found <= NAMED[feature], "the kernel knows more of it: a feature is a room of its own"
    assert found == NAMED[feature], REMEDY


def test_a_robot_loads_fewer_lines() -> None:
    found = loaded_lines(ROOT)
    assert found <= LOADED_LINES, "import what only some missions use where it is used"
    assert found > LOADED_LINES - 300, REMEDY


def test_an_event_enters_fewer_files() -> None:
    step, all_of_kill = outcome()["step"], kill()["all"]
    found = {
        name: (each["files"], each["edges"])
        for name, each in (("step", step), ("kill", all_of_kill))
    }
    for name, figures in found.items():
        assert figures <= WALKS[name], name
        assert figures == WALKS[name], REMEDY


def test_lines_are_counted_by_what_they_say(tree: Tree) -> None:
    code = '''"""Jobs."""
from core import jobs
COUNT = 1  # jobs
if self.jobs is not None:
    job = "a"
    """A text about jobs."""
jobless = 2
'''
    root = tree({"core/a.py": code, "core/jobs.py": "jobs = 1\n", "core/feature.py": "jobs = 1\n"})
    assert naming(root / "core")["jobs"] == (2, 1)


def test_the_table_lists_the_rooms() -> None:
    folders = {path.name for path in (ROOT / "mrbt_mesh" / "features").iterdir() if path.is_dir()}
    assert {*NAMES} == folders - {"__pycache__"}
    assert WORDS.keys() == OWN_FILES.keys() == NAMED.keys() >= {*NAMES}
    assert all(isinstance(each, Feature) for each in features())


@pytest.mark.slow
def test_the_kernel_passes_its_tests_without_features(tmp_path: Path) -> None:
    copy_mesh(tmp_path)
    without_features(tmp_path)
    assert run(tmp_path, KERNEL, "-x").returncode == 0
