"""Files with every change of a tree's statuses, as BehaviorTree.CPP's FileLogger2 writes them.

`BTCPP4-FileLogger2`, the version 1 in one byte, the length of the tree's XML in four and the XML,
the time of the beginning in eight (Unix microseconds), then 9 bytes for each change. Numbers are
little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from mrbt_mesh.adapters.groot2.monitor import FullTree, transition
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.core.mission.mission import Mission
from mrbt_mesh.core.observer.observer import Observer

MAGIC = b"BTCPP4-FileLogger2"
VERSION = 1


class BtlogExport:
    """A log of BehaviorTree.CPP, which Groot2 opens."""

    summary = "Write every change of the tree's statuses, for Groot2."
    suffix = ".btlog"

    def start(
        self, mission: Mission, began_us: int, began_unix_us: int
    ) -> tuple[bytes, Callable[[Observer, int], bytes]]:
        """The header has the tree. Raises InputError for a tree of too many nodes."""
        observed = ObservedTree(mission)
        before = bytes(len(observed.tree.nodes))
        xml = FullTree(observed.tree, observed.title).xml.encode()
        header = MAGIC + bytes([VERSION]) + struct.pack("<i", len(xml)) + xml

        def changes(observer: Observer, now_us: int) -> bytes:
            """What has changed since the last call, in the order of the nodes."""
            nonlocal before
            old, before = before, observed.statuses(observer)
            return b"".join(
                transition(now_us - began_us, index + 1, status)
                for index, status in enumerate(before)
                if status != old[index]
            )

        return header + struct.pack("<q", began_unix_us), changes


export = BtlogExport()
