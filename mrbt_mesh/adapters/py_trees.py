"""Runs a py_trees tree as a local task of a robot's program.

    from mrbt_mesh.adapters.py_trees import local_task

    def fetch() -> py_trees.behaviour.Behaviour: ...

    robot.local_task("fetch")(local_task(fetch, arguments=["goal"]))

Needs the extra `py_trees`. docs/how-to/robot-trees.md describes how such a tree is run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

import anyio

from mrbt_mesh.errors import TaskFailedError, require
from mrbt_mesh.runtime.context import TaskContext
from mrbt_mesh.runtime.program import TaskFunction
from mrbt_mesh.runtime.program_function import ProgramError

if TYPE_CHECKING:
    from py_trees.behaviour import Behaviour
    from py_trees.trees import BehaviourTree

    Tree: TypeAlias = Behaviour | BehaviourTree

RATE_HZ = 10.0


def local_task(
    tree: Tree | Callable[[], Tree],
    *,
    arguments: Sequence[str] = (),
    rate_hz: float = RATE_HZ,
) -> TaskFunction:
    """Return a function for `RobotProgram.local_task` that runs a py_trees tree.

    `tree` is a function that makes a tree for each run, or one tree that all runs use in turn.
    `arguments` are the blackboard keys for the local task's arguments, in order. The tree is ticked
    `rate_hz` times a second until its root is SUCCESS or FAILURE; a failure has the feedback
    message of the behaviour that decided it. When the task is cancelled, the tree is stopped with
    INVALID.

    Every run has a blackboard of its own. `setup` of the behaviours gets `task`, the TaskContext.
    Raises InputError without the extra, and ProgramError for an invalid tree or rate.
    """
    require("a tree of py_trees", "py_trees", "py_trees")
    if rate_hz <= 0:
        raise ProgramError(f"rate_hz is ticks a second, above 0, not {rate_hz!r}")
    if not callable(tree):
        _as_tree(tree)
    running = False

    async def run(task: TaskContext, *values: str) -> None:
        nonlocal running
        if len(values) != len(arguments):
            raise ProgramError(
                f"{task.local_task} has {len(values)} arguments, and its tree of py_trees names "
                f"{len(arguments)}: local_task(..., arguments=[...])"
            )
        if running and not callable(tree):
            raise ProgramError("the tree runs already; give local_task a function that makes one")
        running = True
        try:
            named = zip(arguments, values, strict=True)
            keys = {f"/{name.lstrip('/')}": value for name, value in named}
            await _Run(keys, callable(tree)).to_the_end(tree, task, 1 / rate_hz)
        finally:
            running = False

    return run


def _as_tree(given: Any) -> BehaviourTree:
    from py_trees.behaviour import Behaviour
    from py_trees.trees import BehaviourTree

    if isinstance(given, BehaviourTree):
        return given
    if isinstance(given, Behaviour):
        return BehaviourTree(given)
    raise ProgramError(f"a Behaviour or BehaviourTree of py_trees is expected, not {given!r:.80}")


class _Run:
    """One run with a blackboard of its own; py_trees itself has one per process.

    A tree made for the run also has its own clients, so a key that one of them writes exclusively
    can be written in other robots' trees as well.
    """

    def __init__(self, storage: dict[str, Any], is_made: bool) -> None:
        self.own: dict[str, Any] = {"storage": storage}
        if is_made:
            self.own |= {"metadata": {}, "clients": {}}

    @contextmanager
    def blackboard(self) -> Iterator[None]:
        """Make this run's entries visible to the code in the block, which must not await."""
        from py_trees.blackboard import Blackboard

        others = {name: getattr(Blackboard, name) for name in self.own}
        for name, value in self.own.items():
            setattr(Blackboard, name, value)
        try:
            yield
        finally:
            for name, value in others.items():
                setattr(Blackboard, name, value)

    async def to_the_end(
        self, given: Tree | Callable[[], Tree], task: TaskContext, period_s: float
    ) -> None:
        from py_trees.common import Status

        with self.blackboard():
            tree = _as_tree(given() if callable(given) else given)
            tree.setup(task=task)
        try:
            await self.tick(tree, period_s)
        finally:
            with self.blackboard():
                tree.root.stop(Status.INVALID)
                tree.shutdown()

    async def tick(self, tree: BehaviourTree, period_s: float) -> None:
        from py_trees.common import Status

        due_s = anyio.current_time()
        while True:
            with self.blackboard():
                tree.tick()
                status = tree.root.status
            if status is Status.SUCCESS:
                return
            if status is not Status.RUNNING:
                raise TaskFailedError(_reason(tree))
            # Ticks missed by a slow tick are skipped.
            due_s = max(due_s + period_s, anyio.current_time())
            await anyio.sleep_until(due_s)


def _reason(tree: BehaviourTree) -> str:
    """Return the feedback of the behaviour that decided the failure, or how it ended."""
    tip = tree.tip() or tree.root
    said = tip.feedback_message or tree.root.feedback_message
    return f"{tip.name}: {said}" if said else f"{tip.name} ended as {tip.status.value}"
