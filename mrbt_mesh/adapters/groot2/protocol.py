"""Groot2's protocol, version 2, as bytes.

A request is a ZeroMQ message of one or two parts: a header of 6 bytes and, for some, data. The
reply repeats the header, followed by the 16 bytes of the tree's id, and then has its data. An error
is the text `error` and a second part that says which. Numbers are little-endian.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from mrbt_mesh.core.bt.tree import Status

PROTOCOL = 2
ERROR = b"error"
IDLE_AFTER = 10
_HEADER = struct.Struct("<BBI")
_STATUS = struct.Struct("<HB")
MICROSECOND_BITS = 48


class RequestKind(enum.IntEnum):
    """What a monitor may ask for; all else is of no protocol that is known here."""

    FULL_TREE = ord("T")
    STATUS = ord("S")
    BLACKBOARD = ord("B")
    HOOK_INSERT = ord("I")
    HOOK_REMOVE = ord("R")
    BREAKPOINT_UNLOCK = ord("U")
    HOOKS_DUMP = ord("D")
    REMOVE_ALL_HOOKS = ord("A")
    DISABLE_ALL_HOOKS = ord("X")
    TOGGLE_RECORDING = ord("r")
    GET_TRANSITIONS = ord("t")


@dataclass(frozen=True, slots=True)
class MonitorRequest:
    """A header: what is asked for, and the number by which the answer is known."""

    kind: int
    number: int

    def reply_header(self, tree_id: bytes) -> bytes:
        """The header of the answer; `tree_id`: 16 bytes that change with the tree."""
        return _HEADER.pack(PROTOCOL, self.kind, self.number) + tree_id


def parse_request(header: bytes) -> MonitorRequest | None:
    """A request's header, None for anything that is none of this protocol."""
    if len(header) != _HEADER.size:
        return None
    protocol, kind, number = _HEADER.unpack(header)
    return MonitorRequest(kind, number) if protocol == PROTOCOL else None


def error_reply(text: str) -> list[bytes]:
    """The answer to what cannot be answered."""
    return [ERROR, text.encode()]


def status_buffer(statuses: Iterable[int]) -> bytes:
    """The statuses of the nodes with the uids 1, 2, ...; for those of idle nodes see `shown`."""
    return b"".join(_STATUS.pack(uid, status) for uid, status in enumerate(statuses, 1))


def shown(before: int, status: int) -> int:
    """A node's status as monitors show it: one that is idle again keeps what it was before."""
    if status != Status.IDLE or before == Status.IDLE:
        return status
    return before if before >= IDLE_AFTER else IDLE_AFTER + before


def transition(at_us: int, uid: int, status: int) -> bytes:
    """One change of a status, as in recordings and in .btlog files: 9 bytes.

    `at_us`: since the recording began, modulo 2**48.
    """
    moment = at_us % (1 << MICROSECOND_BITS)
    return moment.to_bytes(MICROSECOND_BITS // 8, "little") + _STATUS.pack(uid, status)
