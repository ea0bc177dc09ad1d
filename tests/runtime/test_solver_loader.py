"""Solvers by name: the project's own, installed ones, and `package.module:function`."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mrbt_mesh.core.assignment.problem import SolverError
from mrbt_mesh.core.assignment.solvers import SOLVERS, default_solver
from mrbt_mesh.formats.build import mission_from_yaml
from mrbt_mesh.formats.mission_file import compile_mission, load_mission
from mrbt_mesh.runtime.solver_loader import GROUP, load_solver, trial_problems
from tests.support.oracle import brute_force
from tests.support.paths import ROOT, mission_file

DOCUMENT = ROOT / "docs" / "how-to" / "constraints.md"
GOOD = (
    "from mrbt_mesh.core.assignment.solvers import min_cost_flow\n"
    "def good(p): return min_cost_flow(p)\n"
)

_number = itertools.count()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the path, as of a user's installed packages."""
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def module(folder: Path, text: str) -> str:
    """A new module with this text; its name."""
    name = f"users_solver_{next(_number)}"
    (folder / f"{name}.py").write_text(text)
    return name


def install(folder: Path, package: str, *points: str) -> None:
    """What pip leaves behind of a package with these entry points."""
    info = folder / f"{package}-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n" + "\n".join(points) + "\n")


@pytest.mark.parametrize("name", sorted(SOLVERS))
def test_the_projects_own_are_found_by_name(name: str) -> None:
    assert load_solver(name, constrained=False) is SOLVERS[name]


def test_no_name_stands_for_the_default_one() -> None:
    assert load_solver(None, constrained=False) is default_solver


def test_a_function_of_a_users_module(folder: Path) -> None:
    name = module(folder, GOOD + "class Kept:\n    nested = staticmethod(good)\n")
    assert load_solver(f"{name}:good", False).__module__ == name
    assert load_solver(f"{name}:Kept.nested", False).__module__ == name


def test_a_name_that_a_package_has_registered(folder: Path) -> None:
    name = module(folder, GOOD)
    install(folder, "fine_solvers", f"fine = {name}:good")
    assert load_solver("fine", False).__module__ == name


def test_a_name_that_two_packages_have_registered_is_refused(folder: Path) -> None:
    name = module(folder, GOOD)
    install(folder, "one_package", f"twice = {name}:good")
    install(folder, "another", f"twice = {name}:other")
    with pytest.raises(SolverError, match="registered more than once, by one_package, another"):
        load_solver("twice", False)


def test_an_entry_point_that_is_no_function_is_the_packages_fault(folder: Path) -> None:
    install(folder, "odd_package", "odd = odd_module")
    with pytest.raises(SolverError, match="package odd_package registers 'odd_module', which is"):
        load_solver("odd", False)


def test_unknown_names_come_with_the_known_ones(folder: Path) -> None:
    install(folder, "fine_package", "excellent = x:y")
    with pytest.raises(SolverError, match="no solver 'cpsat'; did you mean 'cp_sat'"):
        load_solver("cpsat", False)
    with pytest.raises(SolverError, match="known: cp_sat, excellent, min_cost"):
        load_solver("zzz", False)


def test_a_name_that_is_no_solver_any_more_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SolverError, match="no solver 'brute_force'; known: cp_sat, min_cost_flow"):
        load_solver("brute_force", False)


def test_the_trial_problems_have_the_answers_of_the_oracle() -> None:
    for problem, answer in trial_problems():
        assert answer == brute_force(problem)


BAD = {
    "\0": r"\.py: module users_solver_\d+ fails as it is imported: .* null bytes",
    "raise ValueError('at import')": r"\.py:1: module users_solver_\d+ fails as it is imported: "
    "ValueError: at import",
    "import sys\nsys.exit(4)": r"\.py:2: .*SystemExit: 4",
    "def solve(:": r"\.py:1: .*SyntaxError",
    "import nothing_of_that_name": r"\.py:1: .*ModuleNotFoundError",
    "def sovle(p): pass": "has no 'solve'; did you mean 'sovle'",
    "solve = 3": "is a int; a function of one problem is expected",
    "async def solve(p): pass": "is an async function",
    "def solve(): pass": "failed on a trial problem: it raised TypeError",
    "def solve(p): return None": "failed on a trial problem: it finds no assignment, but",
    "def solve(p): return [0] * len(p.robots)": "failed on a trial problem: 3 robots on d1",
    "def solve(p): return [0]": "failed on a trial problem: 1 answers for 3 robots",
}


@pytest.mark.parametrize("text", BAD)
def test_whose_fault_it_is_and_where(folder: Path, text: str) -> None:
    with pytest.raises(SolverError, match=BAD[text]):
        load_solver(f"{module(folder, text)}:solve", False)


def test_a_module_that_is_not_there() -> None:
    with pytest.raises(SolverError, match="install its package, or put its folder on PYTHONPATH"):
        load_solver("not_here.at_all:solve", False)


# -- the document -----------------------------------------------------------------------------


def documented() -> tuple[str, dict[str, Any]]:
    """The solver in the document, and how its package registers it."""
    text = DOCUMENT.read_text()
    (code,) = re.findall(r"```python\n# my_solvers\.py\n(.*?)```", text, re.DOTALL)
    (group, line) = re.findall(r'```toml\n\[project\.entry-points\."(.*?)"\]\n(.*?)\n```', text)[0]
    return code, {"group": group, "line": line.replace('"', "")}


def test_the_documents_example_runs_as_it_stands(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, point = documented()
    assert point["group"] == GROUP
    (folder / "my_solvers.py").write_text(code)
    install(folder, "my_package", point["line"])
    for name in ("my_solvers:milp", "milp"):
        assert load_solver(name, False).__name__ == "milp"


def test_the_document_lists_every_solver_and_no_other() -> None:
    rows = re.findall(r"^\| `(\w+)` \| [A-Zt]", DOCUMENT.read_text(), re.MULTILINE)
    assert set(rows) - {"robots", "demands", "performance"} == set(SOLVERS)


@pytest.mark.parametrize("named", [None, "min_cost_flow", "cp_sat"])
def test_a_solver_has_loaded_its_libraries_before_a_team_waits_for_a_plan(
    named: str | None,
) -> None:
    code = (
        "import sys\n"
        "from mrbt_mesh.runtime.solver_loader import load_solver\n"
        "assert 'ortools' not in sys.modules\n"
        f"load_solver({named!r}, constrained=False)\n"
        "assert 'ortools' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_small_missions_need_no_libraries_and_large_ones_have_them_at_once() -> None:
    """Six robots and 24 demands are small, whichever of them are wanted at the same time."""
    code = (
        "import sys\n"
        "from dataclasses import replace\n"
        "from mrbt_mesh.core.mission.compiled import mission_from_compiled\n"
        "from mrbt_mesh.runtime.solver_loader import solver_for\n"
        "mission = mission_from_compiled(sys.stdin.read(), 'm.json')\n"
        "solver_for(mission)\n"
        "assert not {'ortools', 'numpy'} & sys.modules.keys()\n"
        "robots = {f'R{n}': mission.robots['A1'] for n in range(13)}\n"
        "solver_for(replace(mission, robots=robots))\n"
        "assert 'ortools' in sys.modules\n"
    )
    mission = compile_mission(load_mission(mission_file("vehicle_repair")))
    subprocess.run([sys.executable, "-c", code], check=True, input=mission, text=True)


def test_all_jobs_that_there_may_be_count() -> None:
    text = mission_file("deliveries").read_text(encoding="utf-8")
    for at_most, is_large in ((1, False), (20, True)):
        changed = text.replace("at_most: 20", f"at_most: {at_most}")
        mission = mission_from_yaml(changed, "m.yaml", mission_file("deliveries").parent)
        assert mission.may_need_arrays is is_large
