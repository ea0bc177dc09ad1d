"""All solvers of the comparison find equally good answers, or say that they were not done."""

from __future__ import annotations

import importlib.util
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from benchmarks.assignment import SIZES, Cell, exponent, feasible_in_time, measure, result
from benchmarks.instances import Density, Instance, Spec, Values, draw
from benchmarks.peak import CLEAR, peak_mb, read, save
from benchmarks.registry import MissingPackageError, Setting, need
from benchmarks.solvers import OURS, REFERENCE, SOLVERS, TimeLimitError


def installed(name: str) -> bool:
    return importlib.util.find_spec(SOLVERS[name].needs.partition(".")[0]) is not None


HERE = [name for name in SOLVERS if installed(name)]


def brute_force(instance: Instance) -> int:
    """The best objective over all choices that keep the bounds."""
    options = [
        [-1, *instance.demand[instance.robot == robot].tolist()] for robot in range(instance.robots)
    ]
    found = []
    for choice in product(*options):
        try:
            found.append(instance.objective(np.array(choice)))
        except ValueError:
            continue
    return max(found)


@pytest.mark.parametrize("name", HERE)
def test_a_solver_is_exact(name: str) -> None:
    solver = SOLVERS[name]
    for robots, density, values in product((3, 4, 5), Density, Values):
        for seed in range(4):
            instance = draw(Spec(robots, 4, density, values, seed))
            choice = solver.solve(solver.prepare(instance), 60.0)
            best = brute_force(instance)
            assert instance.objective(choice) == best, f"{robots} {density} {values} seed {seed}"


@pytest.mark.parametrize("name", HERE)
def test_lower_bounds_come_before_performances(name: str) -> None:
    """Robot 0 is far better at demand 0, but only it can serve demand 1."""
    instance = Instance(2, *map(np.array, ([0, 1], [2, 1], [0, 0, 1], [0, 1, 0], [1000, 1, 1])))
    solver = SOLVERS[name]
    assert solver.solve(solver.prepare(instance), 60.0).tolist() == [1, 0]


def test_an_instance_survives_the_file_for_the_child_process(tmp_path: Path) -> None:
    instance = draw(Spec(7, 7, Density.SPARSE, Values.WIDE, 1))
    save(instance, tmp_path / "instance.npz")
    copy = read(tmp_path / "instance.npz")
    assert copy.robots == instance.robots
    for name in ("lower", "upper", "robot", "demand", "performance"):
        assert np.array_equal(getattr(copy, name), getattr(instance, name))


@pytest.mark.skipif(not CLEAR.exists(), reason="needs Linux")
def test_peak_memory_grows_with_the_problem() -> None:
    small = peak_mb(REFERENCE, draw(Spec(6, 6, Density.DENSE, Values.WIDE, 1)), 60.0)
    large = peak_mb(REFERENCE, draw(Spec(400, 400, Density.DENSE, Values.WIDE, 1)), 60.0)
    assert small is not None
    assert large is not None
    pairs = 400 * 400 / 2  # at least a 64-bit cost for each
    assert large - small > pairs * 8 / 2**20


def test_measured_cells_become_rows_and_tables() -> None:
    cells = [Cell(robots, Density.SPARSE, Values.WIDE) for robots in (6, 200, 500, 1000)]
    for cell in cells[:2]:
        measure(cell, range(2), [REFERENCE, OURS], 60.0)
    for cell, factor in zip(cells[2:], (2.5, 5), strict=True):
        cell.kept, cell.pairs = [int(100 * factor)], [int(1000 * factor)]
        cell.times_s = {REFERENCE: [factor], OURS: [2 * factor]}
        cell.ratios = {REFERENCE: [1.0], OURS: [2.0]}
    found = result(cells, Setting(True, 1, lambda _: None))
    assert [row["robots"] for row in found.rows] == [6] * 5 + [200] * 5 + [500] * 5 + [1000] * 5
    first = found.rows[0]
    assert (first["solver"], first["instances"], first["ratio"]) == (REFERENCE, 2, 1.0)
    assert first["same_as_ours"] in (0, 1, 2)
    assert found.rows[1]["same_as_ours"] == 2
    assert found.rows[2]["time_ms"] is None
    for table in found.tables:
        assert {len(row) for row in table.rows} <= {len(table.head)}, table.title
    assert found.tables[0].rows[3][5:7] == ("5,000", "10,000 (2.0)")
    assert found.tables[0].rows[0][7] == "> 60 s"


def test_who_would_take_too_long_is_not_begun() -> None:
    least, small, large = (Cell(robots, Density.DENSE, Values.WIDE) for robots in (50, 250, 1250))
    least.times_s = {"milp": [0.01], "cp_sat": [0.01], OURS: [0.01], REFERENCE: [0.1]}
    small.times_s = {"milp": [2.3], "cp_sat": [2.5], OURS: [2.3], REFERENCE: [2.3]}
    before = [least, small]
    assert feasible_in_time(large, before, "milp")  # 25 times as many pairs: 57.5 s
    assert not feasible_in_time(large, before, "cp_sat")
    # Those without a limit as they grew: 230 times would be too long, 23 times is not.
    assert not feasible_in_time(large, before, OURS)
    assert feasible_in_time(large, before, REFERENCE)
    assert feasible_in_time(large, [small], OURS)
    assert feasible_in_time(large, [], "milp")
    small.beyond_limit = {"milp"}
    assert not feasible_in_time(large, before, "milp")
    assert not feasible_in_time(large, before, "linear_sum_assignment")


def test_a_wrong_answer_is_not_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def worse(instance: Instance, limit_s: float) -> np.ndarray:
        spec = SOLVERS[REFERENCE]
        negated = Instance(
            instance.robots,
            instance.lower,
            instance.upper,
            instance.robot,
            instance.demand,
            1001 - instance.performance,
        )
        return spec.solve(negated, limit_s)

    spoilt = SOLVERS["milp"].__class__("spoilt", worse, "numpy")
    monkeypatch.setitem(SOLVERS, "milp", spoilt)
    with pytest.raises(RuntimeError, match=r"6 robots, dense, performances 1\.\.1000, seed 1"):
        measure(Cell(6, Density.DENSE, Values.WIDE), [1], [REFERENCE, "milp"], 60.0)


def test_a_solver_that_is_not_done_in_time_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def slow(instance: Instance, limit_s: float) -> np.ndarray:
        calls.append(instance)
        raise TimeLimitError

    monkeypatch.setitem(SOLVERS, "cp_sat", SOLVERS["cp_sat"].__class__("slow", slow, "numpy"))
    cell = Cell(6, Density.DENSE, Values.WIDE)
    measure(cell, range(3), [REFERENCE, "cp_sat"], 60.0)
    assert len(calls) == 1
    assert cell.time_s("cp_sat") is None
    assert len(cell.times_s[REFERENCE]) == 3


def test_exponent_of_a_power() -> None:
    assert exponent([(10, 3 * 10**1.5), (100, 3 * 100**1.5), (1000, 3 * 1000**1.5)]) == (
        pytest.approx(1.5)
    )


def test_sizes_grow() -> None:
    """A size is skipped by what the one before took."""
    assert all(list(sizes) == sorted(set(sizes)) for sizes in SIZES.values())


def test_what_is_missing_is_named_with_the_remedy() -> None:
    with pytest.raises(MissingPackageError, match=r"no_such.*pip install -e '\.\[bench\]'"):
        need("no_such.module")
