"""Finds the solver that a mission or a command names: see docs/how-to/constraints.md.

A name is `min_cost_flow` or `cp_sat`, a name that an installed package registers in the entry-point
group `mrbt_mesh.solvers`, or `package.module:function`.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import os
import re
import traceback
from dataclasses import replace
from functools import cache
from types import ModuleType
from typing import Any

from mrbt_mesh.core.assignment.problem import (
    PLANNER_MODULES,
    AssignmentProblem,
    Bounds,
    Limit,
    Shared,
    Solver,
    SolverError,
    supports_constraints,
)
from mrbt_mesh.core.assignment.solvers import SOLVERS, default_solver
from mrbt_mesh.core.engine import DEFINITIONS, FASTEST, Engine
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.mission.planner_need import planner_problem
from mrbt_mesh.errors import is_installed, nearest

GROUP = "mrbt_mesh.solvers"
PLAIN_VARIABLE = "MRBT_PLAIN"
_SPELLED_OUT = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)")


def solver_for(mission: Mission, named: str | None = None) -> Solver:
    """Return the solver named by a command, else by the mission, else the default one.

    Raises SolverError if it cannot be used for this mission, also if libraries are missing.
    """
    if problem := planner_problem(mission, lacks_planner(), named):
        raise SolverError(problem)
    is_small = not mission.may_need_arrays
    return load_solver(named or mission.solver, mission.limits is not None, is_small)


def lacks_planner() -> bool:
    """Return whether the libraries for large and constrained assignment problems are missing."""
    return not all(map(is_installed, PLANNER_MODULES))


def load_solver(named: str | None, constrained: bool, is_small: bool = False) -> Solver:
    """Return the solver of this name (None: the default one), after a trial on a few small
    problems.

    `constrained`: it will get side constraints. `is_small`: problems will be so small that the
    default solver, without constraints, needs no library, and none is loaded. Raises SolverError
    with the remedy, and with the line if the user's module itself fails.
    """
    solver = default_solver if named is None else SOLVERS.get(named) or _users_solver(named)
    if constrained and not supports_constraints(solver):
        raise SolverError(
            f"solver {named!r} does not support side constraints, which are given here: use cp_sat"
            + ("" if named in SOLVERS else ", or set its attribute supports_constraints = True")
        )
    if solver is default_solver and is_small and not constrained:
        return solver
    try:
        _try_out(solver, constrained)
    except SolverError as error:
        raise SolverError(f"solver {named!r} failed on a trial problem: {error}") from error
    return solver


def _try_out(solver: Solver, constrained: bool) -> None:
    """Solve trial problems, which also loads the solver's libraries before a team waits for its
    plan.

    Raises SolverError if it breaks its contract on a small problem.
    """
    from mrbt_mesh.core.assignment.canonical import solve

    trials = trial_problems()
    if solver is default_solver and not constrained:
        default_solver(trials[0][0])
        return
    for problem, answer in trials:
        if constrained or not problem.constraints:
            found = solve(problem, solver)
            if found != answer:
                raise SolverError(f"{found} is not the answer to {problem}")


@cache
def trial_problems() -> tuple[tuple[AssignmentProblem, tuple[int, ...] | None], ...]:
    """Return small problems, each with its canonical optimum."""
    plain = AssignmentProblem.of(
        ("r1", "r2", "r3"),
        (Bounds("d1", 1, 2), Bounds("d2", 1, 1)),
        ({0: 2, 1: 3}, {0: 2, 1: 3}, {0: 1}),
    )
    return (
        (plain, (0, 1, 0)),
        (replace(plain, demands=(Bounds("d1", 0, 3), Bounds("d2", 0, 3))), (1, 1, 0)),
        (replace(plain, demands=(Bounds("d1", 2, 2), Bounds("d2", 2, 2))), None),
        (AssignmentProblem.of((), (Bounds("d1", 0, 1),), ()), ()),
        (replace(plain, constraints=(Limit((0, 1), (0,), 0),)), (1, -1, 0)),
        (replace(plain, demands=(Bounds("d1", 0, 2), *plain.demands[1:])), (0, 1, 0)),
        (replace(plain, constraints=(Shared(((0,), (1,)), 1),)), None),
    )


def _users_solver(named: str) -> Solver:
    spelled_out = _SPELLED_OUT.fullmatch(named)
    found = _in_module(spelled_out[1], spelled_out[2]) if spelled_out else _registered(named)
    if not callable(found):
        kind = type(found).__name__
        raise SolverError(f"solver {named!r} is a {kind}; a function of one problem is expected")
    if inspect.iscoroutinefunction(found):
        raise SolverError(f"solver {named!r} is an async function; an ordinary one is expected")
    solver: Solver = found
    return solver


def _registered(name: str) -> Any:
    """Return what an installed package registered under this name."""
    from importlib import metadata

    points = metadata.entry_points(group=GROUP)
    named = points.select(name=name)
    matching = sorted({(point.value, point.dist.name if point.dist else "?") for point in named})
    if not matching:
        known = [*SOLVERS, *sorted(points.names)]
        raise SolverError(
            f"no solver {name!r}{nearest(name, known)}; one of your own is written "
            "package.module:function, or registered by its package"
        )
    if len(matching) > 1:
        packages = ", ".join(package for _, package in matching)
        raise SolverError(
            f"solver {name!r} is registered more than once, by {packages}: uninstall one, or write "
            "package.module:function"
        )
    ((value, package),) = matching
    spelled_out = _SPELLED_OUT.fullmatch(value)
    if spelled_out is None:
        raise SolverError(
            f"solver {name!r}: package {package} registers {value!r}, which is not "
            "package.module:function"
        )
    return _in_module(spelled_out[1], spelled_out[2])


def _in_module(module: str, path: str) -> Any:
    found: Any = _imported(module)
    for name in path.split("."):
        if not hasattr(found, name):
            hint = nearest(name, [key for key, value in vars(found).items() if callable(value)])
            raise SolverError(f"solver {module}:{path}: {module} has no {name!r}{hint}")
        found = getattr(found, name)
    return found


def _imported(module: str) -> ModuleType:
    try:
        return importlib.import_module(module)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and error.name in _prefixes(module):
            raise SolverError(
                f"there is no module {error.name!r} for solver {module}: install its package, or "
                "put its folder on PYTHONPATH"
            ) from error
        raise SolverError(
            f"{_place_of(error, module)}: module {module} fails as it is imported: "
            f"{type(error).__name__}: {error}"
        ) from error


def _place_of(error: BaseException, module: str) -> str:
    """Return the file and line that fail.

    Only the file if it cannot be compiled, e.g. for null bytes.
    """
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno or 0}"
    importing = (__file__, importlib.__file__)
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename not in importing and not f.filename.startswith("<")]
    if own:
        return f"{own[-1].filename}:{own[-1].lineno}"
    spec = importlib.util.find_spec(module)
    return str(spec.origin) if spec is not None else module


def _prefixes(module: str) -> list[str]:
    parts = module.split(".")
    return [".".join(parts[: count + 1]) for count in range(len(parts))]


def chosen_engine() -> Engine:
    """Return the reference engine if the environment asks for it, else the faster one: same
    answers.
    """
    return DEFINITIONS if os.environ.get(PLAIN_VARIABLE) == "1" else FASTEST
