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
from typing import Any, TypeVar

from mrbt_mesh.btcpp.executor.blackboard import Blackboard
from mrbt_mesh.btcpp.executor.builder import build_nodes
from mrbt_mesh.btcpp.executor.engine import TickEngine
from mrbt_mesh.btcpp.executor.leaf_nodes import LeafNode
from mrbt_mesh.btcpp.executor.leaves import Leaves
from mrbt_mesh.btcpp.executor.node import NodeStatus, TreeNode, TreeWorld
from mrbt_mesh.btcpp.executor.runner import TreeRunner
from mrbt_mesh.btcpp.files.check import check_library
from mrbt_mesh.btcpp.files.document import parse_document
from mrbt_mesh.btcpp.files.findings import Findings
from mrbt_mesh.btcpp.files.library import Library, library_of, load_library
from mrbt_mesh.errors import FileError, Problem, nearest

RATE_HZ = 10.0
F = TypeVar("F", bound=Callable[..., Any])
N = TypeVar("N", bound=type[TreeNode])


@dataclass(frozen=True, slots=True)
class NodeView:
    """One node as a view shows it. `depth` counts from 0; `reason`: what a leaf failed of."""

    uid: int
    depth: int
    type: str
    name: str
    path: str
    status: NodeStatus
    reason: str = ""


class BehaviorTree:
    """One tree that can be run, any number of times, one after the other.

    `leaves` may be shared by trees; without it the tree has its own. `exact` switches
    BehaviorTree.CPP's own oddities on (docs/reference/btcpp-nodes.md). `given`: what leaves get
    besides ports, by its type. The blackboard stays from run to run.
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
        self.name = _chosen(library, tree)
        self.leaves = leaves if leaves is not None else Leaves()
        self.blackboard = Blackboard(exact=exact)
        self._library = library
        self._enums = dict(enums or {})
        self._world = TreeWorld(exact, given=dict(given or {}))
        self._engine: TickEngine | None = None
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
        """Read a file with all that it includes. Raises FileError.

        `tree` is a tree's ID, by default the main tree; `package_folders` are where `ros_pkg` of
        an <include> is looked for.
        """
        findings = Findings()
        library = load_library(Path(path), findings, package_folders)
        check_library(library, findings)
        findings.raise_errors()
        return cls(library, tree, leaves, exact=exact, enums=enums, given=given)

    @classmethod
    def from_text(
        cls,
        text: str,
        tree: str | None = None,
        leaves: Leaves | None = None,
        *,
        exact: bool = False,
        enums: Mapping[str, int] | None = None,
    ) -> BehaviorTree:
        """As `from_file`, from memory; includes are not followed. Raises FileError."""
        findings = Findings()
        library = library_of(parse_document(text, "tree.xml"), findings)
        check_library(library, findings)
        findings.raise_errors()
        return cls(library, tree, leaves, exact=exact, enums=enums)

    def action(self, name: str) -> Callable[[F], F]:
        """Register an action: see `Leaves.action`."""
        return self.leaves.action(name)

    def condition(self, name: str) -> Callable[[F], F]:
        """Register a condition: see `Leaves.condition`."""
        return self.leaves.condition(name)

    def node(self, name: str) -> Callable[[N], N]:
        """Register a control or decorator: see `Leaves.node`."""
        return self.leaves.node(name)

    def entry(self, name: str) -> Callable[[F], F]:
        """Register what says an entry's value before each tick: see `Leaves.entry`."""
        return self.leaves.entry(name)

    def source(self, name: str) -> Callable[[F], F]:
        """Register what Nav2's decorators ask for: see `Leaves.source`."""
        return self.leaves.source(name)

    @property
    def engine(self) -> TickEngine:
        """The tree's engine, made when it is needed first. Raises FileError.

        From then on the leaves are fixed. Who ticks by himself needs nothing else of this class.
        """
        if self._engine is None:
            world, leaves = self._world, self.leaves
            world.enums = leaves.enums | self._enums
            world.sources = {n: value.bound(world.given) for n, value in leaves.sources.items()}
            world.entries = {n: value.bound(world.given) for n, value in leaves.entries.items()}
            nodes = build_nodes(self._library, self.name, self.leaves, self._world, self.blackboard)
            self._engine = TickEngine(nodes, self._world, self.blackboard)
        return self._engine

    def check(self) -> None:
        """Raise FileError, with all that is missing, unless the tree can be run."""
        _ = self.engine

    async def run(
        self, *, rate_hz: float = RATE_HZ, clock: Callable[[], float] | None = None
    ) -> NodeStatus:
        """Tick the tree until its root is not RUNNING: SUCCESS, FAILURE or SKIPPED.

        It is ticked when an action ends, a program sets an entry, a node's time is over or `wake`
        is called, and `rate_hz` times a second for what changes unheard: conditions. 0: never.
        Cancelled, it cancels its actions and waits for them. Raises FileError, TickError, and
        what a leaf raises but for TaskFailedError.
        """
        if self._runner is not None:
            raise RuntimeError("the tree is running already")
        self._runner = TreeRunner(self.engine, rate_hz, clock, self._ticked)
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
        """All nodes in preorder with their statuses as of the last tick. Raises FileError."""
        engine = self.engine
        statuses = engine.statuses()
        waiting = [(engine.root, 0)]
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


def _chosen(library: Library, tree: str | None) -> str:
    """The tree to run. Raises FileError if it is not there, or not clear."""
    name = tree or library.main_tree
    if name is not None and name in library.trees:
        return name
    document, known = library.documents[0], ", ".join(library.trees) or "none"
    if tree is None:
        message = f"main_tree_to_execute names none of the trees; name one of: {known}"
    else:
        message = f"there is no tree {tree!r}{nearest(tree, list(library.trees))}"
    raise FileError([Problem(document.file, document.root.line, "root", message)])
