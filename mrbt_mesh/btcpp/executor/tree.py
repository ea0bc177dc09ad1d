"""A behavior tree of one robot, from a BehaviorTree.CPP file, run by Python functions.

tree = BehaviorTree.from_file("navigate.xml")

@tree.action("MoveTo")
async def move_to(goal: str) -> None:
    await base.drive(goal)

tree.blackboard["goal"] = "dock"
status = await tree.run()
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrbt_mesh.btcpp.executor.blackboard import Blackboard
from mrbt_mesh.btcpp.executor.builder import build_nodes
from mrbt_mesh.btcpp.executor.leaf_nodes import LeafNode
from mrbt_mesh.btcpp.executor.leaves import Leaves
from mrbt_mesh.btcpp.executor.node import NodeStatus, TreeWorld
from mrbt_mesh.btcpp.executor.runner import TreeRunner
from mrbt_mesh.btcpp.executor.tree_executor import TreeExecutor
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.findings import Finding, Findings
from mrbt_mesh.btcpp.files.library import Library, load_library, load_text

RATE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class NodeView:
    """One node as a view shows it. `depth` counts from 0; `reason`: why a leaf failed."""

    uid: int
    depth: int
    type: str
    name: str
    path: str
    status: NodeStatus
    reason: str = ""


class BehaviorTree:
    """One tree that can be run any number of times, one run at a time.

    `library` must have been checked. `leaves` may be shared by trees; by default the tree has its
    own. `exact` turns BehaviorTree.CPP's own oddities on (docs/reference/btcpp-nodes.md). `given`:
    arguments of leaves other than ports, by type. The blackboard is kept between runs.
    """

    def __init__(
        self,
        library: Library,
        tree: str | None = None,
        leaves: Leaves | None = None,
        *,
        exact: bool = False,
        enums: Mapping[str, int] | None = None,
        given: Mapping[type, Any] | None = None,
    ) -> None:
        self.name = library.chosen_tree(tree)
        # Findings that are valid but probably not intended, in file order.
        self.warnings: Sequence[Finding] = ()
        self.leaves = leaves if leaves is not None else Leaves()
        # Decorators that register functions and nodes: see `Leaves`.
        self.action, self.condition = self.leaves.action, self.leaves.condition
        self.node, self.entry, self.source = self.leaves.node, self.leaves.entry, self.leaves.source
        self.blackboard = Blackboard(exact=exact)
        self._library = library
        self._enums = dict(enums or {})
        self._world = TreeWorld(exact, given=dict(given or {}))
        self._executor: TreeExecutor | None = None
        self._runner: TreeRunner | None = None
        self._watchers: list[Callable[[], None]] = []
        self.blackboard.watch(self.wake)

    @classmethod
    def from_file(
        cls,
        path: Path | str,
        tree: str | None = None,
        leaves: Leaves | None = None,
        *,
        exact: bool = False,
        enums: Mapping[str, int] | None = None,
        given: Mapping[type, Any] | None = None,
        package_folders: Sequence[Path] = (),
    ) -> BehaviorTree:
        """Read a file and all files it includes. Raises FileError.

        `tree` is a tree's ID, by default the main tree. `package_folders` are searched for the
        `ros_pkg` of an <include>.
        """
        findings = Findings()
        library = load_library(Path(path), findings, package_folders)
        check_library(library, findings)
        findings.raise_errors()
        made = cls(library, tree, leaves, exact=exact, enums=enums, given=given)
        made.warnings = findings.warnings
        return made

    @classmethod
    def from_text(
        cls,
        text: str,
        tree: str | None = None,
        leaves: Leaves | None = None,
        *,
        file: Path | str = "tree.xml",
        exact: bool = False,
        enums: Mapping[str, int] | None = None,
        given: Mapping[type, Any] | None = None,
        package_folders: Sequence[Path] = (),
    ) -> BehaviorTree:
        """Like `from_file`, from a text. Includes are relative to the folder of `file`.

        The file itself need not exist; by default its folder is the current one.
        """
        findings = Findings()
        library = load_text(text, Path(file), findings, package_folders)
        check_library(library, findings)
        findings.raise_errors()
        made = cls(library, tree, leaves, exact=exact, enums=enums, given=given)
        made.warnings = findings.warnings
        return made

    @property
    def executor(self) -> TreeExecutor:
        """The executor that ticks the tree.

        Made at its first use; leaves registered later are ignored. Raises FileError.
        """
        if self._executor is None:
            world, leaves = self._world, self.leaves
            world.enums = leaves.enums | self._enums
            world.sources = {n: value.bound(world.given) for n, value in leaves.sources.items()}
            world.entries = {n: value.bound(world.given) for n, value in leaves.entries.items()}
            nodes = build_nodes(self._library, self.name, self.leaves, self._world, self.blackboard)
            self._executor = TreeExecutor(nodes, self._world, self.blackboard)
        return self._executor

    def check(self) -> None:
        """Raise FileError, listing everything that is missing, unless the tree can be run."""
        _ = self.executor

    async def run(
        self, *, rate_hz: float = RATE_HZ, clock: Callable[[], float] | None = None
    ) -> NodeStatus:
        """Tick the tree until its root is no longer RUNNING; returns the root's status.

        The tree is ticked when an action ends, the program sets an entry, a node's deadline passes
        or `wake` is called. It is also ticked `rate_hz` times a second (0: never), because
        conditions change without notice. When cancelled, it cancels its actions and waits for them.
        Raises FileError, TickError, and any error of a leaf except TaskFailedError.
        """
        if self._runner is not None:
            raise RuntimeError("the tree is running already")
        self._runner = TreeRunner(self.executor, rate_hz, clock, self._ticked)
        try:
            return await self._runner.run()
        finally:
            self._runner = None

    def wake(self) -> None:
        """Tick a running tree soon."""
        if self._runner is not None:
            self._runner.wake()

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` after every tick."""
        self._watchers.append(watcher)

    def _ticked(self) -> None:
        for watcher in self._watchers:
            watcher()

    def view(self) -> Iterator[NodeView]:
        """Yield all nodes in preorder with their statuses as of the last tick. Raises FileError."""
        executor = self.executor
        statuses = executor.statuses()
        waiting = [(executor.root, 0)]
        while waiting:
            node, depth = waiting.pop()
            reason = node.reason if isinstance(node, LeafNode) else ""
            yield NodeView(
                node.uid,
                depth,
                node.type,
                node.name,
                node.place.path,
                NodeStatus(statuses[node.uid - 1]),
                reason,
            )
            waiting += [(child, depth + 1) for child in reversed(node.children)]
