"""A solver in a process of its own.

OR-tools holds the interpreter's lock while it solves, so a large problem that is solved in a
thread stops the event loop all the same, and the robot falls silent. Waiting for another process
does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from mrbt_mesh.core.assignment.problem import (
    AssignmentProblem,
    Integers,
    Solver,
    SolverError,
    supports_constraints,
)

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

# Problems with fewer pairs take a few milliseconds at most, about as long as to hand them over.
LARGE_PAIRS = 20_000
CLOSE_TIMEOUT_S = 1.0
ATTEMPTS = 2

Answer: TypeAlias = "Sequence[int] | Integers | None"


class SolverProcess:
    """Wraps a solver, which is a function of a module: it has to be found there by the process.

    Small problems are solved at once. One caller at a time.
    """

    def __init__(self, solver: Solver, large_pairs: int = LARGE_PAIRS) -> None:
        self._solver = solver
        self.supports_constraints = supports_constraints(solver)
        self._large_pairs = large_pairs
        self._process: Any = None
        self._line: Connection | None = None

    def start(self) -> None:
        """Start the process, which takes about a second until it can solve; once is enough."""
        if self._process is None or not self._process.is_alive():
            import multiprocessing  # for large teams

            # Not forked: Zenoh's threads and OR-tools' state would not survive that.
            context = multiprocessing.get_context("spawn")
            self._line, other = context.Pipe()
            self._process = context.Process(target=_serve, args=(other, self._solver), daemon=True)
            self._process.start()
            other.close()

    def __call__(self, problem: AssignmentProblem) -> Answer:
        """What the solver answers. Raises what it raises, SolverError if its process ends."""
        if len(problem.pair_robot) < self._large_pairs:
            return self._solver(problem)
        for attempt in range(ATTEMPTS):
            self.start()
            assert self._line is not None
            try:
                self._line.send(problem)
                good, answer = self._line.recv()
                break
            except (EOFError, OSError) as error:
                self.close()
                if attempt + 1 == ATTEMPTS:
                    raise SolverError(f"the solver's process ends at once: {error!r}") from error
        if not good:
            raise answer
        found: Answer = answer
        return found

    @property
    def pid(self) -> int | None:
        """The process, if there is one."""
        return None if self._process is None else self._process.pid

    def close(self) -> None:
        """End the process; it also ends by itself when this one does."""
        if self._line is not None:
            self._line.close()
            self._process.join(CLOSE_TIMEOUT_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
            self._process, self._line = None, None


def _serve(line: Connection, solver: Solver) -> None:
    """Solve what comes, until the other end is closed."""
    while True:
        try:
            problem = line.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        try:
            answer: tuple[bool, Any] = True, solver(problem)
        except (
            Exception,
            SystemExit,
        ) as error:  # the caller gets it
            answer = False, error
        line.send(answer)
