"""What a monitor may ask of one tree, and what it is told."""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Sequence

import msgpack

from mrbt_mesh.adapters.groot2.full_tree import FullTree
from mrbt_mesh.adapters.groot2.protocol import (
    MonitorRequest,
    RequestKind,
    error_reply,
    parse_request,
    shown,
    status_buffer,
    transition,
)
from mrbt_mesh.adapters.node_statuses import ObservedTree
from mrbt_mesh.core.bt.tree import Kind
from mrbt_mesh.core.observer.observer import Observer

TREE_ID_BYTES = 16
# As many as BehaviorTree.CPP keeps for a monitor that does not fetch them.
MAX_TRANSITIONS = 1_000
NO_HOOKS = "not supported: robots go on without each other's leave, there are no breakpoints"
TWO_PARTS = "must be 2 parts message"
_HOOKS = (RequestKind.HOOK_INSERT, RequestKind.HOOK_REMOVE, RequestKind.BREAKPOINT_UNLOCK)
# A monitor that leaves wants all hooks to be gone, which they are.
_GONE = (RequestKind.REMOVE_ALL_HOOKS, RequestKind.DISABLE_ALL_HOOKS)
_MORE = frozenset({RequestKind.BLACKBOARD, RequestKind.TOGGLE_RECORDING, *_HOOKS})


class MonitoredTree:
    """Answers requests of a monitor; `update` it when the observer has seen something."""

    def __init__(self, observed: ObservedTree, observer: Observer) -> None:
        """Raises InputError for a tree of more nodes than the protocol can number."""
        self._observed = observed
        self._observer = observer
        self._full = FullTree(observed.tree, observed.title)
        text = f"{observed.title}\0{observer.mission.digest}\0{observer.facts.run}"
        leaves = (node for node in observer.mission.tree.nodes if node.kind is Kind.CONDITION)
        self._conditions = {node.subject for node in leaves}
        self._tree_id = hashlib.blake2b(text.encode(), digest_size=TREE_ID_BYTES).digest()
        self._statuses = bytes(len(observed.tree.nodes))
        self._shown = list(self._statuses)
        self._buffer = status_buffer(self._shown)
        self._transitions: deque[bytes] = deque(maxlen=MAX_TRANSITIONS)
        self._recording_since_us: int | None = None

    def update(self, now_us: int) -> None:
        """Take over the statuses as they are now."""
        statuses = self._observed.statuses(self._observer)
        if statuses == self._statuses:
            return
        for index, (before, status) in enumerate(zip(self._statuses, statuses, strict=True)):
            if before != status:
                self._shown[index] = shown(self._shown[index], status)
                if self._recording_since_us is not None:
                    since_us = now_us - self._recording_since_us
                    self._transitions.append(transition(since_us, index + 1, status))
        self._statuses = statuses
        self._buffer = status_buffer(self._shown)

    def answer(self, parts: Sequence[bytes], now_us: int) -> list[bytes]:
        """The reply to one request, whatever it is."""
        request = parse_request(parts[0]) if parts else None
        if request is None:
            return error_reply("wrong request header")
        data = self._data(request, parts[1] if len(parts) == 2 else None, now_us)
        if isinstance(data, str):
            return error_reply(data)
        header = request.reply_header(self._tree_id)
        return [header] if data is None else [header, data]

    def _data(self, request: MonitorRequest, more: bytes | None, now_us: int) -> bytes | str | None:
        """What follows the header: data, nothing (None), or in place of both an error (text)."""
        if request.kind in _MORE and more is None:
            return TWO_PARTS
        match request.kind:
            case RequestKind.FULL_TREE:
                return self._full.xml.encode()
            case RequestKind.STATUS:
                return self._buffer
            case RequestKind.BLACKBOARD:
                return self._blackboards(more or b"")
            case RequestKind.TOGGLE_RECORDING:
                return self._record(more or b"", now_us)
            case RequestKind.GET_TRANSITIONS:
                found = b"".join(self._transitions)
                self._transitions.clear()
                return found
            case RequestKind.HOOKS_DUMP:
                return b"[]"
            case kind if kind in _GONE:
                return None
            case kind if kind in _HOOKS:
                return NO_HOOKS
            case _:
                return "Request not recognized"

    def _blackboards(self, names: bytes) -> bytes:
        """Conditions of T_G as entries, for each of the blackboards that are named and known."""
        holds, known = self._observer.facts.condition, self._full.blackboards
        wanted = [name for name in names.decode(errors="replace").split(";") if name in known]
        entries = {
            name: {each: holds(each) for each in known[name] if each in self._conditions}
            for name in wanted
        }
        return bytes(msgpack.packb(entries))

    def _record(self, word: bytes, now_us: int) -> bytes | None:
        """Begin to keep transitions, and say when that is in Unix microseconds; or end it."""
        if word == b"start":
            self._recording_since_us = now_us
            self._transitions.clear()
            return str(time.time_ns() // 1_000).encode()
        if word == b"stop":
            self._recording_since_us = None
        return None
