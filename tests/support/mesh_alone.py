"""The mesh's own tests in a copy of the project from which the periphery is deleted.

    python -m tests.support.mesh_alone               # all of them, as `make test-mesh`
    python -m tests.support.mesh_alone tests/core    # some

A test that imports the periphery is about both, and is left out.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.support.paths import ROOT

PERIPHERY = ("adapters", "analysis", "btcpp", "views")
COPIED = ("agents", "deploy", "docs", "drills", "examples", "mrbt_mesh", "pyproject.toml", "tests")
# They need the plug-in for trees of BehaviorTree.CPP.
WITH_TREES = (
    *("examples/assembly", "examples/inspection", "examples/lift"),
    *("tests/formats/test_program_trees.py", "tests/sim/test_run_soak.py"),
)
DESELECTED = (
    "not inspect and not assembl and not lift and not tree_in_a_file and not examples_are_where"
)
TESTS = tuple(
    f"tests/{name}"
    for name in ("core", "drills", "formats", "observer", "recording", "runtime", "sim")
)
_IMPORT = re.compile(rf"^\s*(?:from|import) (?:mrbt_mesh|tests)\.(?:{'|'.join(PERIPHERY)})\b", re.M)
_SHARED = re.compile(r"^\s*from (tests\.support[\w.]*) import", re.M)


def copy_mesh(target: Path) -> list[str]:
    """Copy the project without the periphery; returns the files of tests that are left out."""
    ignored = shutil.ignore_patterns("__pycache__", "node_modules")
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, target / name)
    for name in (*PERIPHERY, *WITH_TREES):
        for path in (target / name, target / "mrbt_mesh" / name, target / "tests" / name):
            shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
    left_out: list[str] = []
    texts = {path: path.read_text(encoding="utf-8") for path in (target / "tests").rglob("*.py")}
    while gone := [path for path, text in texts.items() if _needs_periphery(text, target)]:
        for path in gone:
            path.unlink()
            del texts[path]
            left_out.append(path.relative_to(target).as_posix())
    return sorted(left_out)


def without_features(target: Path) -> None:
    """Delete the features from a copy: the kernel's table has none."""
    shutil.rmtree(target / "mrbt_mesh" / "features")
    table = target / "mrbt_mesh" / "core" / "feature.py"
    text = table.read_text(encoding="utf-8")
    emptied = re.sub(r"^(NAMES: .*?= )\(.*?\)$", r"\1()", text, flags=re.M | re.S)
    assert emptied != text
    table.write_text(emptied, encoding="utf-8")


def _needs_periphery(text: str, target: Path) -> bool:
    """Whether tests import the periphery, or something of tests/support that is left out."""
    shared = (target.joinpath(*name.split(".")) for name in _SHARED.findall(text))
    is_lost = any(not each.is_dir() and not each.with_suffix(".py").exists() for each in shared)
    return is_lost or _IMPORT.search(text) is not None


def run(target: Path, tests: tuple[str, ...], *options: str) -> subprocess.CompletedProcess[str]:
    """Run tests of a copy that start no processes."""
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *options]
    command += ["-m", "not processes", "-k", DESELECTED, *tests]
    where = {**os.environ, "PYTHONPATH": str(target)}
    return subprocess.run(command, cwd=target, env=where, check=False, text=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="mesh-alone-") as folder:
        print("left out:", *copy_mesh(Path(folder)), flush=True)  # noqa: T201
        done = run(Path(folder), tuple(sys.argv[1:]) or TESTS, "-n", "auto")
    sys.exit(done.returncode)
