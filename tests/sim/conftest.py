"""Fixtures that the tests of the simulator share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from mrbt_mesh.runtime import solver_loader
from mrbt_mesh.sim.checkers import plans
from tests.support.compared_plans import compared
from tests.support.effort import SIZE, Size
from tests.support.oracle import brute_force
from tests.support.runs import Run, run_example

plans.first_of_the_best = brute_force

# Chaos compares each plan itself (I7), and its mutants must be found by it alone.
COMPARED_BY_THEMSELVES = ("test_chaos", "test_chaos_dirty_check", "test_chaos_mutations")


@pytest.fixture(scope="module", autouse=True)
def _plans_are_those_of_the_definitions(request: pytest.FixtureRequest) -> Iterator[None]:
    """In the gate a quarter of these tests' plans is made by the plain definitions as well."""
    with pytest.MonkeyPatch.context() as patch:
        module = request.module.__name__.rpartition(".")[2]
        if SIZE is not Size.QUICK and module not in COMPARED_BY_THEMSELVES:
            patch.setattr(solver_loader, "FASTEST", compared(solver_loader.FASTEST, 4))
        yield


@pytest.fixture
def run() -> Run:
    """`run(name, seed, ...)`: simulate an example; no invariant may break on the way."""
    return run_example
