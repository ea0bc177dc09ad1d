"""Files with every change of a tree's statuses, as BehaviorTree.CPP's FileLogger2 writes them.

`BTCPP4-FileLogger2`, the version 1 in one byte, the length of the tree's XML in four and the XML,
the time of the beginning in eight (Unix microseconds), then 9 bytes for each change. Numbers are
little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from mrbt_mesh.adapters.groot2.monitor import FullTree, transition
from mrbt_mesh.adapters.node_statuses import GlobalTree, ObservedTree
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
        """The header has the tree."""
        log = Btlog(GlobalTree(mission))
        changes = lambda observer, now_us: log.changes(observer, now_us - began_us)  # noqa: E731
        return log.header(began_unix_us), changes


export = BtlogExport()


class Btlog:
    """The bytes of one file, piece by piece; times are microseconds since its beginning."""

    def __init__(self, observed: ObservedTree) -> None:
        """Raises InputError for a tree of more nodes than such a file can number."""
        self._observed = observed
        self._xml = FullTree(observed.tree, observed.title).xml.encode()
        self._statuses = bytes(len(observed.tree.nodes))

    def header(self, began_unix_us: int) -> bytes:
        """What the file begins with."""
        length = struct.pack("<i", len(self._xml))
        return MAGIC + bytes([VERSION]) + length + self._xml + struct.pack("<q", began_unix_us)

    def changes(self, observer: Observer, at_us: int) -> bytes:
        """What has changed since the last call, in the order of the nodes."""
        statuses = self._observed.statuses(observer)
        before, self._statuses = self._statuses, statuses
        return b"".join(
            transition(at_us, index + 1, status)
            for index, status in enumerate(statuses)
            if status != before[index]
        )
