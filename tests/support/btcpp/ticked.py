"""Trees in XML whose leaves say in a port what each of their ticks returns.

tree = Ticked('<Sequence><Leaf says="RUNNING SUCCESS"/><Leaf says="FAILURE"/></Sequence>')
assert tree.run(2) == [RUNNING, FAILURE]
assert tree.ticks == [2, 1]
"""

from __future__ import annotations

from typing import Any

from mrbt_mesh.btcpp import BehaviorTree, Leaves, NodeStatus, TreeNode
from mrbt_mesh.btcpp.executor.node import IDLE, Source


class Leaf(TreeNode):
    """`says` lists the statuses of its ticks; the last one repeats."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.ticks = self.halts = 0

    def tick(self) -> NodeStatus:
        self.ticks += 1
        self.world.count_leaf(self.place)
        says = self.ports["says"].split()
        return NodeStatus[says[min(self.ticks, len(says)) - 1]]

    def halt(self) -> None:
        self.halts += 1
        super().halt()


class Note(TreeNode):
    """Keeps the values that its port `what` has had."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.seen: list[Any] = []

    def tick(self) -> NodeStatus:
        self.seen.append(self.input("what", ""))
        return NodeStatus.SUCCESS


class Ticked:
    """One tree, ticked by hand. `yields=False`: Repeat and its kin loop within a tick.

    `sources`: what its nodes ask the program for; `says`: what the program says of entries.
    """

    def __init__(
        self,
        body: str,
        entries: dict[str, Any] | None = None,
        *,
        trees: str = "",
        exact: bool = False,
        yields: bool = True,
        enums: dict[str, int] | None = None,
        sources: dict[str, Source] | None = None,
        says: dict[str, Source] | None = None,
    ) -> None:
        leaves = Leaves()
        for name, source in (sources or {}).items():
            leaves.source(name)(source)
        for name, source in (says or {}).items():
            leaves.entry(name)(source)
        leaves.node("Leaf")(Leaf)
        leaves.node("Note")(Note)
        text = (
            '<root BTCPP_format="4" main_tree_to_execute="Main">'
            f'<BehaviorTree ID="Main">{body}</BehaviorTree>{trees}</root>'
        )
        self.tree = BehaviorTree.from_text(text, None, leaves, exact=exact, enums=enums)
        self.board = self.tree.blackboard
        for name, value in (entries or {}).items():
            self.board[name] = value
        self.executor = self.tree.executor
        self.now_ms = 0
        for node in self.executor.nodes:
            node.yields = node.yields and yields

    def run(self, count: int = 1) -> list[NodeStatus]:
        """The statuses of `count` ticks."""
        return [self.executor.tick(self.now_ms * 1_000) for _ in range(count)]

    def once(self) -> NodeStatus:
        """Tree::tickOnce."""
        return self.executor.tick_once(self.now_ms * 1_000)

    @property
    def leaves(self) -> list[Leaf]:
        return [node for node in self.executor.nodes if isinstance(node, Leaf)]

    @property
    def ticks(self) -> list[int]:
        return [leaf.ticks for leaf in self.leaves]

    @property
    def halts(self) -> list[int]:
        return [leaf.halts for leaf in self.leaves]

    @property
    def seen(self) -> list[Any]:
        return [
            value for node in self.executor.nodes if isinstance(node, Note) for value in node.seen
        ]

    @property
    def is_idle(self) -> bool:
        return all(node.status is IDLE for node in self.executor.nodes)
